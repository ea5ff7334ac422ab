"""What a whole study says: tests between conditions, curves over them, the paper's figures and statements."""
