"""Nothing that the site's pages load comes from elsewhere: they are read from a file, without a network."""

from __future__ import annotations

import re
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError

LOADED = re.compile(r"""<(?:script|link|img|iframe|source)\b[^>]*\b(?:src|href)=["']?(?:https?:)?//[^>]*>""")
IN_STYLES = re.compile(r"""(?:@import|url\()\s*["']?(?:https?:)?//[^)]*""")
FETCHED_WHERE_USED = re.compile(r"""class=["']?mermaid\b""")
"""The theme fetches what draws these."""


def on_post_build(config: MkDocsConfig) -> None:
    """PluginError: a page or a style loads something from another address."""
    site = Path(config.site_dir)
    for pattern, files in (
        (LOADED, "*.html"),
        (FETCHED_WHERE_USED, "*.html"),
        (IN_STYLES, "*.html"),
        (IN_STYLES, "*.css"),
    ):
        for path in sorted(site.rglob(files)):
            if found := pattern.search(path.read_text(encoding="utf-8")):
                raise PluginError(f"{path.relative_to(site)} loads {found[0][:200]}")
