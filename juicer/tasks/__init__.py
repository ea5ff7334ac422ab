"""Assembly tasks as plain data: parts, threads, start poses, and when they count as assembled."""
