#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes openapi.json: openapi.yaml with view.schema.json inside, so that tools need one file.

  bundle_openapi.py PROTOCOL_DIR OUTPUT

The schema View becomes components/schemas/View, and its $defs become components of their own, named View_NAME. Every
reference in the output begins with '#/'; the script fails if one does not. The build runs it; the daemon serves the output.
"""
import json
import sys

try:
    import yaml
except ImportError as e:
    sys.exit(f'bundle_openapi.py: {e}; install python3-yaml')

SCHEMA = 'view.schema.json'
COMPONENTS = '#/components/schemas/'


def rename_references(node, rename):
    """Replaces the value of each $ref below `node` by rename(value)."""
    if isinstance(node, dict):
        if isinstance(node.get('$ref'), str):
            node['$ref'] = rename(node['$ref'])
        for child in node.values():
            rename_references(child, rename)
    elif isinstance(node, list):
        for child in node:
            rename_references(child, rename)


def from_schema(reference):
    """'#/$defs/NAME' of view.schema.json, as seen from the output."""
    return reference.replace('#/$defs/', f'{COMPONENTS}View_')


def from_document(reference):
    """A reference of openapi.yaml, as seen from the output."""
    if reference == SCHEMA:
        return f'{COMPONENTS}View'
    return reference.replace(f'{SCHEMA}#/', f'{COMPONENTS}View/')


def must_be_local(reference):
    if not reference.startswith('#/'):
        sys.exit(f'bundle_openapi.py: the reference {reference} leads out of the document; only {SCHEMA} can be included')
    return reference


def bundle(folder):
    with open(f'{folder}/openapi.yaml', encoding='utf-8') as f:
        document = yaml.safe_load(f)
    with open(f'{folder}/{SCHEMA}', encoding='utf-8') as f:
        view = json.load(f)
    rename_references(document, from_document)
    rename_references(view, from_schema)
    parts = view.pop('$defs')
    del view['$schema']  # OpenAPI 3.1 uses the same dialect
    schemas = document['components']['schemas']
    schemas['View'] = view
    schemas.update({f'View_{name}': part for name, part in parts.items()})
    rename_references(document, must_be_local)
    return document


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__.strip())
    with open(sys.argv[2], 'w', encoding='utf-8') as f:
        json.dump(bundle(sys.argv[1]), f, ensure_ascii=False, separators=(',', ':'))
        f.write('\n')


if __name__ == '__main__':
    main()
