"""How jaxball was installed, for a sentence that says how to install more."""

import importlib.metadata
import json
import urllib.parse
import urllib.request


def pip_install(extra: str) -> str:
    """The command that installs what an extra of jaxball needs: from the folder that jaxball came from, if it did."""
    text = importlib.metadata.distribution("jaxball").read_text("direct_url.json")
    source = json.loads(text) if text else {}
    if "dir_info" not in source:
        return f"pip install 'jaxball[{extra}]'"
    folder = urllib.request.url2pathname(urllib.parse.urlsplit(source["url"]).path)
    return f"pip install {'-e ' * bool(source['dir_info'].get('editable'))}'{folder}[{extra}]'"
