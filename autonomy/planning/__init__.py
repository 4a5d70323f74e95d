"""Where to go next: candidate sites, information, routes over water."""
