"""The web pages for people: browsing, teleoperation and annotation, by one server on this machine."""
