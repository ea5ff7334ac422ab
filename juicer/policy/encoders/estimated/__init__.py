"""Features of a state as an estimator reads them off images; learned from true poses, never shown them when acting."""
