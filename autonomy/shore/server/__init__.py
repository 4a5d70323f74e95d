"""The page of the people ashore: an HTTP server of everything that the vehicles publish. Needs aiohttp."""
