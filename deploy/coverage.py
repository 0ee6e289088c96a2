#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Prints the line coverage of each folder after the tests ran in a build with gcov (preset "coverage").

  coverage.py BUILD [--source DIR] [--files]

A line counts as covered if any object file that contains it executed it. --files prints each file as well.
"""
import argparse
import collections
import concurrent.futures
import json
import os
import subprocess

PARTS = ('renderer/', 'protocol/', 'server/', 'clients/')


def notes(build):
    """Paths of the .gcno files below the build folder, as absolute paths."""
    for folder, _, names in os.walk(os.path.abspath(build)):
        for name in names:
            if name.endswith('.gcno'):
                yield os.path.join(folder, name)


def lines_of(note):
    """(file, line, is covered) of each line in one object file; a file that never ran counts as not covered."""
    done = subprocess.run(['gcov', '--json-format', '--stdout', note], capture_output=True, text=True, check=False,
                          cwd=os.path.dirname(note))
    found = []
    for text in done.stdout.splitlines():
        if text.startswith('{'):
            data = json.loads(text)
            for file in data['files']:
                path = os.path.normpath(os.path.join(data['current_working_directory'], file['file']))
                found += [(path, line['line_number'], line['count'] > 0) for line in file['lines']]
    return found


def collect(build, source):
    """For each of the project's own files: line number → is covered."""
    files = collections.defaultdict(dict)
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        for found in pool.map(lines_of, notes(build)):
            for path, number, is_covered in found:
                name = os.path.relpath(path, source)
                if name.startswith(PARTS):
                    files[name][number] = files[name].get(number, False) or is_covered
    return files


def print_table(title, counts):
    print(f'{title:44} {"lines":>7} {"covered":>8} {"percent":>8}')
    for name, (total, covered) in sorted(counts.items()):
        print(f'{name:44} {total:7} {covered:8} {100 * covered / total:8.1f}')


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('build')
    parser.add_argument('--source', default=os.path.abspath(os.path.join(os.path.dirname(__file__), '..')))
    parser.add_argument('--files', action='store_true')
    options = parser.parse_args()
    per_file = {name: (len(lines), sum(lines.values())) for name, lines in collect(options.build, options.source).items() if lines}
    if not per_file:
        raise SystemExit(f'coverage.py: no gcov data below {options.build}: build the preset "coverage" and run its tests first')
    folders = collections.defaultdict(lambda: (0, 0))
    for name, counts in per_file.items():
        for folder in (os.path.dirname(name), 'all'):
            folders[folder] = tuple(a + b for a, b in zip(folders[folder], counts))
    if options.files:
        print_table('file', per_file)
    print_table('folder', folders)


if __name__ == '__main__':
    main()
