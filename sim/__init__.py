"""A simulated ocean and vessel, so that all of halocline runs on a laptop."""
