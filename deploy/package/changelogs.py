#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes changelog.gz and changelog.Debian.gz from CHANGELOG.md.

  changelogs.py CHANGELOG OUT_DIR
"""
import datetime
import email.utils
import gzip
import os
import re
import sys

MAINTAINER = 'splatd maintainers <maintainers@splatd.invalid>'


def main():
    with open(sys.argv[1], encoding='utf-8') as file:
        text = file.read()
    entries = []
    for version, date in re.findall(r'^## \[([0-9.]+)\] - ([0-9-]+)$', text, re.M):
        when = datetime.datetime.fromisoformat(date).replace(hour=12, tzinfo=datetime.timezone.utc)
        entries.append(f'splatd ({version}-1) stable; urgency=medium\n\n  * Version {version}; changelog.gz describes it.\n\n'
                       f' -- {MAINTAINER}  {email.utils.format_datetime(when)}\n')
    os.makedirs(sys.argv[2], exist_ok=True)
    for name, content in (('changelog.gz', text), ('changelog.Debian.gz', '\n'.join(entries))):
        with open(os.path.join(sys.argv[2], name), 'wb') as file:
            file.write(gzip.compress(content.encode(), 9, mtime=0))


if __name__ == '__main__':
    main()
