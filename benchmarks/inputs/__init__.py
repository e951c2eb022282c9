"""Bad inputs to every command, and odd ones that are fine: none may surprise a user.

A bad one ends with one plain sentence and an exit status that is not 0, and leaves nothing behind;
no exception's name or traceback is seen, nothing hangs, nothing outside the folder is touched, no
pickle runs, and no host is looked up or connected to.
"""
