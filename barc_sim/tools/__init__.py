"""What the everyday looks at a running system are made of: echo, topics and param."""
