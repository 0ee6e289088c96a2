#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Runs schemathesis, a tester of OpenAPI contracts, against the daemon.

  schemathesis_test.py SPLATD SCHEMATHESIS

SCHEMATHESIS is the program that deploy/test.sh installs from requirements.txt. The seed is fixed; SPLATD_SEED chooses
another one, SPLATD_EXAMPLES how many requests are made for each operation. Exit status 77: skipped.
"""
import os
import re
import subprocess
import sys
import tempfile

from contract_test import Daemon, json

FOLDER = os.path.dirname(os.path.abspath(__file__))
LIMIT_S = 480  # ends a run that hangs, with time for a busy machine; the run takes about 70 s of processor time


def main():
    program, schemathesis = sys.argv[1:3]
    if not os.access(schemathesis, os.X_OK):
        print(f'skipped: {schemathesis} is not installed; deploy/test.sh installs tests/protocol/requirements.txt')
        return 77
    daemon = Daemon(program, '--sessions', '1000', '--views', '1000', '--frame-size', '262144')  # large images take time and test nothing here
    command = [schemathesis, '--config-file', f'{FOLDER}/schemathesis.toml', '--no-color', 'run',
               f'http://{daemon.host}/api/v1/openapi.json', '-H', f'Authorization: Bearer {daemon.token}',
               '--url', f'http://{daemon.host}', '--checks', 'all', '--seed', os.environ.get('SPLATD_SEED', '1'),
               '--max-examples', os.environ.get('SPLATD_EXAMPLES', '12')]
    try:
        with tempfile.TemporaryDirectory() as scratch:
            done = subprocess.run(command, cwd=scratch, timeout=LIMIT_S, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                                  env={**os.environ, 'PYTHONPATH': FOLDER, 'PYTHONDONTWRITEBYTECODE': '1'}, text=True)
    finally:
        status, log = daemon.stop()
    summary = re.search(r'\d+ generated.*', done.stdout)
    print(done.stdout[-20000:] if done.returncode else summary and summary.group())
    if status != 0 or 'Sanitizer' in log or 'runtime error' in log:
        print(f'FAILED: splatd ended with {status}: {log[-4000:]}')
        return 1
    return 1 if done.returncode else 0


if __name__ == '__main__':
    sys.exit(main())
