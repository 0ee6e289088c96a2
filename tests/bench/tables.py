# SPDX-License-Identifier: Apache-2.0
"""CSV files → numbers → tables of Markdown."""
import csv
import os
import re

ORDER = ('engine', 'bonsai', 'bonsai-full', 'lobster', 'head', 'head-full', 'aneurism', 'checkerboard', 'sparse', 'bonsai-soft', 'turbulence', 'noise')
EQUAL_DB = 999  # of a PSNR: from here on the images are equal


def read(folder, name):
    path = os.path.join(folder, name)
    if not os.path.exists(path):
        return []
    with open(path, encoding='utf-8', newline='') as f:
        return [{k: number(v) for k, v in row.items()} for row in csv.DictReader(f)]


def number(text):
    try:
        return float(text)
    except ValueError:
        return text


def table(head, rows):
    if not rows:
        return ''
    lines = ['| ' + ' | '.join(head) + ' |', '|' + '---|' * len(head)]
    return '\n'.join(lines + ['| ' + ' | '.join(str(c) for c in row) + ' |' for row in rows]) + '\n'


def short(value, digits=3):
    """A number with three significant digits; a dash for a missing one."""
    if value in ('', None):
        return '–'
    if value >= 10 ** (digits - 1):
        return f'{value:.0f}'
    return f'{value:.{digits}g}'


def decibels(value):
    return '–' if value == '' else 'equal' if value >= EQUAL_DB else f'{value:.1f} dB'


def met(is_met):
    return 'met' if is_met else '**missed**'


VERDICT = re.compile(r'(?<=[|:] )(met|\*\*missed\*\*)(?=[ ,:])')


def verdicts(text):
    """Counts the goals in tables: how many are met, how many are missed, and the first cells of the rows with a missed goal."""
    met_count, missed_count, where = 0, 0, []
    for line in text.split('\n'):
        found = VERDICT.findall(line) if line.startswith('|') else []
        met_count += found.count('met')
        missed_count += len(found) - found.count('met')
        first = line.split('|')[1].strip() if found else ''
        if '**missed**' in found and first not in where:
            where.append(first)
    return met_count, missed_count, where


def ordered(rows):
    return sorted(rows, key=lambda r: ORDER.index(r['scene']) if r['scene'] in ORDER else len(ORDER))


def find(rows, **wanted):
    return next((r for r in rows if all(r[k] == v for k, v in wanted.items())), None)
