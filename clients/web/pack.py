#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Prepares the page for embedding: pack.py OUT FILE...

Copies the files, which are relative to this folder, to OUT. Scripts and style sheets lose their comments and indentation, about a fifth of
the compressed page; each line keeps its number, so that a stack trace still fits the source. index.html asks for all modules at once
instead of import by import.
"""
import os
import re
import sys

HERE = os.path.dirname(os.path.abspath(__file__))
MAIN = '  <script type="module" src="app/main.js"></script>\n'


def strip(text):
    """Empties lines that hold nothing but a comment, except the first, and removes indentation. Templates stay as they are."""
    lines, in_comment, in_template = [], False, False
    for number, line in enumerate(text.split('\n')):
        bare = line.strip()
        if in_comment:
            in_comment = '*/' not in bare
            lines.append('')
        elif in_template:
            in_template ^= len(re.findall(r'(?<!\\)`', line)) % 2 == 1
            lines.append(line)
        elif number and (bare.startswith('//') or (bare.startswith('/*') and (bare.endswith('*/') or '*/' not in bare))):
            in_comment = bare.startswith('/*') and '*/' not in bare
            lines.append('')
        else:
            in_template = len(re.findall(r'(?<!\\)`', line)) % 2 == 1
            lines.append(bare if not in_template else line)
    return '\n'.join(lines)


def preload(page, files):
    """Adds the modules that app/main.js imports, directly or not; workers and other languages are not among them."""
    found, todo = [], ['app/main.js']
    while todo:
        name = todo.pop()
        with open(os.path.join(HERE, name), encoding='utf-8') as f:
            text = f.read()
        for target in re.findall(r"^(?:import|export)\b[^;]*?'(\.[^']+)';", text, re.M):
            module = os.path.normpath(os.path.join(os.path.dirname(name), target)).replace(os.sep, '/')
            if module not in files:
                sys.exit(f'pack.py: {name} imports {module}, which clients/web/CMakeLists.txt does not list')
            if module not in found:
                found.append(module)
                todo.append(module)
    if MAIN not in page:
        sys.exit('pack.py: index.html does not start app/main.js as expected')
    return page.replace(MAIN, MAIN + ''.join(f'  <link rel="modulepreload" href="{module}">\n' for module in sorted(found)))


def main(out, files):
    for name in files:
        with open(os.path.join(HERE, name), encoding='utf-8') as f:
            text = f.read()
        if name.endswith(('.js', '.css')):
            text = strip(text)
        elif name == 'index.html':
            text = preload(text, files)
        path = os.path.join(out, name)
        os.makedirs(os.path.dirname(path), exist_ok=True)
        with open(path, 'w', encoding='utf-8', newline='\n') as f:
            f.write(text)


if __name__ == '__main__':
    main(sys.argv[1], sys.argv[2:])
