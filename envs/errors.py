"""The one exception that means 'the user can put this right'; the command line prints it as one line and exits with 2."""


class UserError(Exception):
    """Says in one line what is wrong, where, and what to do about it."""
