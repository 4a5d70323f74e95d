"""What we believe: the sparse online Gaussian process, its hyperparameters and its memory."""
