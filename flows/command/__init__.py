"""The ``juicer`` command: one module a command."""
