"""What a user did that can't be done, in one sentence."""


class UserError(ValueError):
    """Names the value, what was expected and what to do; ends a command with exit code 2."""
