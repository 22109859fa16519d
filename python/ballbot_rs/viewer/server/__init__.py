"""The server of the page: what clients may request and send, links and files."""
