"""Where parts are, learned from images: what an estimator is shown, and how it learns."""
