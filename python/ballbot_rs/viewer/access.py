"""Access rules of the page's server."""

import re

from websockets.datastructures import Headers

#: Host names that a browser on this machine may use; a tunnel may use another port.
AUTHORITY = re.compile(r"(?:127\.0\.0\.1|localhost|\[::1\])(?::(\d{1,5}))?", re.ASCII | re.IGNORECASE)
ORIGIN = re.compile(r"https?://(.*)", re.ASCII | re.IGNORECASE | re.DOTALL)

ELSEWHERE = "this server is only for this machine"


def refusal(path: str, headers: Headers) -> str | None:
    """The reason for refusing a request, or None.

    A path must not leave the client's folder, which viser does not check. A foreign `Host` is another site's page whose
    name was pointed at this machine (DNS rebinding). A foreign `Origin` is another page, possibly on this machine, that
    accesses this server. Programs other than browsers send no `Origin`.
    """
    file = path.partition("?")[0]
    if ".." in file.split("/") or "//" in file or any(c in file for c in "\\:") or "%5c" in file.lower():
        return "no such file"
    hosts, origins = headers.get_all("Host"), headers.get_all("Origin")
    if len(hosts) != 1 or not is_own(hosts[0]) or len(origins) > 1:
        return ELSEWHERE
    for origin in origins:
        match = ORIGIN.fullmatch(origin)
        if match is None or not is_own(match[1]) or match[1].lower() != hosts[0].lower():
            return ELSEWHERE
    return None


def is_own(authority: str) -> bool:
    """Whether HOST or HOST:PORT, strictly as in RFC 3986, names this machine."""
    match = AUTHORITY.fullmatch(authority)
    return match is not None and (match[1] is None or 1 <= int(match[1]) <= 65535)
