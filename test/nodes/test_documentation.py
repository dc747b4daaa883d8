import importlib.util
import re
import tomllib
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from impactscope.version import __version__

ROOT = Path(__file__).parents[2]


def written_by(script):
    spec = importlib.util.spec_from_file_location('document', ROOT / 'scripts' / script)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.document()


@pytest.mark.ros
def test_the_page_of_nodes_is_what_the_nodes_say():
    said = (ROOT / 'docs/nodes.md').read_text(encoding='utf-8')
    assert written_by('document_nodes.py') == said, 'run scripts/document_nodes.py'


def test_the_page_of_mechanisms_is_what_the_mechanisms_say():
    said = (ROOT / 'docs/mechanisms.md').read_text(encoding='utf-8')
    assert written_by('document_mechanisms.py') == said, 'run scripts/document_mechanisms.py'


def test_versions_agree():
    package = ET.parse(ROOT / 'package.xml').findtext('version')
    project = tomllib.loads((ROOT / 'pyproject.toml').read_text(encoding='utf-8'))['project']
    assert package == project['version'] == __version__


@pytest.mark.parametrize('path', sorted((ROOT / 'msg').glob('*.msg')), ids=lambda p: p.stem)
def test_every_field_of_a_message_is_explained(path):
    text = path.read_text(encoding='utf-8')
    assert re.search(r'^uint8 SCHEMA_VERSION=[1-9]', text, re.MULTILINE)
    if path.stem == 'SampleBlock':  # fixed as it is
        return
    for line in text.splitlines():
        if line.strip() and not line.startswith('#') and 'SCHEMA_VERSION' not in line:
            assert re.search(r'#\s*\S', line), line


def test_files_named_in_the_readme_exist():
    readme = (ROOT / 'README.md').read_text(encoding='utf-8')
    for name in re.findall(r'\]\(([^)#:]+)\)', readme):
        assert (ROOT / name).exists(), name
