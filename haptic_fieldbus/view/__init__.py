"""The live view: a page in the browser and the process that serves it."""

import hashlib
import hmac


def token_for_once(token: str) -> str:
    """Return the token that opens a page once in place of `token`, which cannot be computed from it.

    Other users of the computer can read the address with which a browser is started.
    """
    return hmac.new(token.encode(), b"once", hashlib.sha256).hexdigest()
