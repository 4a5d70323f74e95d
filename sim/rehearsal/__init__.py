"""A whole mission at the desk: the boat's own configuration and core on a sea that is known (`sim dry-run`)."""
