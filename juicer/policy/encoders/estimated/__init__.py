"""Features of a state as an estimator reads them off images; taught with true poses, which no policy sees."""
