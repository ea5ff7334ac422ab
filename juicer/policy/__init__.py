"""Policies: what an observation looks like to a network, and how a network turns it into an action chunk."""
