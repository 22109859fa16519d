"""Policy files for tests."""

import json
import zipfile


def edited_policy(source, target, edit):
    """A copy of a policy file, its data changed by `edit`."""
    with zipfile.ZipFile(source) as old, zipfile.ZipFile(target, "w") as new:
        for name in old.namelist():
            content = old.read(name)
            if name == "data":
                data = json.loads(content)
                data = edit(data) or data
                content = json.dumps(data).encode()
            new.writestr(name, content)
    return target
