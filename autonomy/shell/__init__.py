"""The only code that waits, reads clocks, or touches the network."""
