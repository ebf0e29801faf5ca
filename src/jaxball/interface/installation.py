"""How jaxball was installed, for a sentence that says how to install more."""

import importlib.metadata
import json


def pip_install(extra: str) -> str:
    """The command that installs what an extra of jaxball needs: from the folder that jaxball came from, if it did."""
    text = importlib.metadata.distribution("jaxball").read_text("direct_url.json")
    folder = json.loads(text or "{}").get("dir_info")
    if folder is None:
        return f"pip install 'jaxball[{extra}]'"
    return f"pip install {'-e ' if folder.get('editable') else ''}'.[{extra}]' in jaxball's folder"
