"""The other end of the link: people ashore watching the nowcast."""
