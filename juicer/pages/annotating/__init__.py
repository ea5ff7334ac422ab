"""Marking critical states: what is proposed, beside images and signals, to be accepted or corrected by keys."""
