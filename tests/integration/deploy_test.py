#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Holds the files of deploy/ against the daemon: what they name exists.

  deploy_test.py SPLATD SOURCE_DIR
"""
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import unittest
import urllib.request

DEADLINE_S = 60
FOLDER = os.path.join(sys.argv[2], 'deploy')


def read(name):
    with open(os.path.join(FOLDER, name), encoding='utf-8') as f:
        return f.read()


def options_of(text):
    return set(re.findall(r'--[a-z][a-z-]+', text))


class Deploy(unittest.TestCase):
    def test_options_exist(self):
        known = options_of(subprocess.run([sys.argv[1], '--help'], capture_output=True, text=True, check=True).stdout)
        unit = re.search(r'^ExecStart=/usr/bin/splatd (.*)$', read('splatd.service'), re.M)[1]
        entry = ' '.join(json.loads(re.search(r'^ENTRYPOINT (.*)$', read('Containerfile'), re.M)[1]))
        for text in unit, entry:
            self.assertTrue(options_of(text) and options_of(text) <= known, options_of(text) - known)

    def test_metrics_exist(self):
        daemon = subprocess.Popen([sys.argv[1], '--listen', '127.0.0.1:0', '--backend', 'null', '--volume',
                                   'demo:engine?size=8'], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        try:
            address = daemon.stdout.readline().decode().split()[-1]
            with urllib.request.urlopen(address.replace('/?', '/metrics?'), timeout=DEADLINE_S) as answer:
                text = answer.read().decode()
        finally:
            daemon.terminate()
            daemon.wait(DEADLINE_S)
            daemon.stdout.close()
        families = set(re.findall(r'^# TYPE (\S+) ', text, re.M))
        labels = set(re.findall(r'[{,]([a-z]+)="', text)) | {'le'}
        wanted = json.loads(read('dashboard.json'))['panels'] + [{'targets': [{'expr': e, 'legendFormat': ''}]} for e in
                                                                re.findall(r'expr: (.*)', read('prometheus.yml'))]
        for panel in wanted:
            for target in panel['targets']:
                names = re.findall(r'\b(?:splatd|process)_[a-z_]+', target['expr'])
                self.assertTrue(names, target)
                for name in names:
                    self.assertIn(re.sub('_bucket$', '', name), families)
                used = re.findall(r'by \(([^)]*)\)', target['expr']) + re.findall(r'{{(.*?)}}', target['legendFormat'])
                for name in ', '.join(used).split(', ') if used else []:
                    self.assertIn(name, labels)

    def test_unit_is_understood(self):
        """By systemd itself, where it is installed."""
        tool = shutil.which('systemd-analyze')
        if not tool:
            self.skipTest('no systemd-analyze')
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, 'splatd.service')
            with open(path, 'w', encoding='utf-8') as f:
                f.write(read('splatd.service').replace('/usr/bin/splatd', os.path.abspath(sys.argv[1])))
            done = subprocess.run([tool, 'verify', '--man=no', path], capture_output=True, text=True, check=False)
        about = [line for line in (done.stdout + done.stderr).splitlines() if 'splatd.service' in line]
        self.assertEqual(about, [])


if __name__ == '__main__':
    unittest.main(argv=sys.argv[:1], verbosity=2)
