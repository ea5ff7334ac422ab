"""Critical states: proposed, labelled by people, annotated."""
