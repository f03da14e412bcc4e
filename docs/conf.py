"""Sphinx configuration: sphinx-build -W -b html docs target/docs-site"""

import sys
from pathlib import Path

project = "evrig"
author = "The evrig authors"
# Signatures and docstrings are read from the source; the compiled module is not needed for them.
sys.path.insert(0, str(Path(__file__).parents[1] / "python"))
autodoc_mock_imports = ["evrig._evrig", "rerun", "torch"]
autodoc_typehints = "none"
autodoc_class_signature = "mixed"
napoleon_use_ivar = True
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
myst_enable_extensions = ["dollarmath", "deflist", "colon_fence"]
myst_heading_anchors = 3
html_theme = "furo"
html_title = "evrig"
html_copy_source = False
