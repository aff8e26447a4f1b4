"""The one exception that means 'the user can put this right'; the command line prints it as one line and exits with 2."""


class UserError(Exception):
    """Says in one line what is wrong, where, and what to do about it."""


def one_line(error: BaseException, *, named: bool = False) -> str:
    """What `error` says, without line breaks; `named` puts its type before it."""
    return " ".join((f"{type(error).__name__}: {error}" if named else str(error)).split())
