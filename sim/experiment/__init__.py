"""Experiments: the paper's figures, comparisons with what people use today, and the sweeps that carry them."""
