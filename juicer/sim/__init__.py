"""Contact-rich furniture assembly in MuJoCo."""
