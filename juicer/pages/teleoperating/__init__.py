"""Teleoperation in the browser: the page, and the socket over which it sees and steers."""
