#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Compares the files of deploy/ with the daemon: everything that they name must exist.

  deploy_test.py SPLATD SOURCE_DIR
"""
import glob
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import unittest
import urllib.error
import urllib.request

try:
    import yaml
except ImportError:
    yaml = None

DEADLINE_S = 60
FOLDER = os.path.join(sys.argv[2], 'deploy')
DEPENDED = {'libebml-dev'}  # comes with libmatroska-dev


def read(name):
    with open(os.path.join(FOLDER, name), encoding='utf-8') as f:
        return f.read()


def options_of(text):
    return set(re.findall(r'--[a-z][a-z-]+', text))


def model(name):
    if not yaml:
        raise unittest.SkipTest('no python3-yaml')
    return yaml.safe_load(read(name))


def open_source(name):
    with open(os.path.join(sys.argv[2], name), encoding='utf-8') as f:
        return f.read()


class Daemon:
    """A daemon with a small volume; get() sends it a request."""

    def __init__(self, *arguments):
        self.child = subprocess.Popen([sys.argv[1], '--listen', '127.0.0.1:0', '--backend', 'null', '--volume', 'demo:engine?size=8', *arguments],
                                      stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        address = self.child.stdout.readline().decode().split()[-1]
        self.port = int(re.search(r':(\d+)', address)[1])
        self.token = (re.search(r'token=(\w+)', address) or ['', ''])[1]

    def get(self, path, token=None):
        request = urllib.request.Request(f'http://127.0.0.1:{self.port}{path}', headers={'Authorization': f'Bearer {token or self.token}'})
        try:
            with urllib.request.urlopen(request, timeout=DEADLINE_S) as answer:
                return answer.status, answer.read().decode()
        except urllib.error.HTTPError as error:
            with error:
                return error.code, ''

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.child.terminate()
        self.child.wait(DEADLINE_S)
        self.child.stdout.close()


class Deploy(unittest.TestCase):
    def test_options_exist(self):
        known = options_of(subprocess.run([sys.argv[1], '--help'], capture_output=True, text=True, check=True).stdout)
        unit = re.search(r'^ExecStart=/usr/bin/splatd (.*)$', read('splatd.service'), re.M)[1]
        entry = ' '.join(json.loads(re.search(r'^ENTRYPOINT (.*)$', read('Containerfile'), re.M)[1]))
        for text in unit, entry:
            self.assertTrue(options_of(text))
            self.assertLessEqual(options_of(text), known)

    def test_metrics_exist(self):
        with Daemon() as daemon:
            text = daemon.get('/metrics')[1]
        families = set(re.findall(r'^# TYPE (\S+) ', text, re.M))
        labels = set(re.findall(r'[{,]([a-z]+)="', text)) | {'le', 'job'}
        rules = [rule for group in model('alerts.yml')['groups'] for rule in group['rules']]
        wanted = [target for panel in json.loads(read('dashboard.json'))['panels'] for target in panel['targets']]
        for target in wanted + [{'expr': rule['expr'], 'legendFormat': ''} for rule in rules]:
            names = re.findall(r'\b(?:splatd|process)_[a-z_]+|\bup\b', target['expr'])
            self.assertTrue(names, target)
            for name in names:
                self.assertIn(re.sub('_bucket$', '', name), families | {'up'})
            used = re.findall(r'by \(([^)]*)\)', target['expr']) + re.findall(r'{{(.*?)}}', target['legendFormat'])
            used += re.findall(r'[{,]\s*([a-z]+)=', target['expr'])
            for name in ', '.join(used).split(', ') if used else []:
                self.assertIn(name, labels)
        self.assertEqual(len({rule['alert'] for rule in rules}), len(rules))

    def test_grafana_accepts_the_dashboard(self):
        """Each panel has its own id and its own place on 24 columns, a data source that a variable names, and queries with different
        ids."""
        board = json.loads(read('dashboard.json'))
        sources = {'${%s}' % v['name'] for v in board['templating']['list'] if v['type'] == 'datasource' and v['query'] == 'prometheus'}
        self.assertEqual(len({panel['id'] for panel in board['panels']}), len(board['panels']))
        taken = set()
        for panel in board['panels']:
            self.assertEqual(panel['type'], 'timeseries')
            self.assertEqual(panel['datasource']['type'], 'prometheus')
            self.assertIn(panel['datasource']['uid'], sources)
            self.assertIn(panel['fieldConfig']['defaults']['unit'], {'short', 's', 'bytes', 'Bps', 'percentunit', 'reqps'})
            names = [target['refId'] for target in panel['targets']]
            self.assertEqual(names, sorted(set(names)))
            place = panel['gridPos']
            self.assertLessEqual(place['x'] + place['w'], 24)
            cells = {(x, y) for x in range(place['x'], place['x'] + place['w']) for y in range(place['y'], place['y'] + place['h'])}
            self.assertFalse(cells & taken, panel['title'])
            taken |= cells

    def test_the_commands_of_the_unit_create_tokens(self):
        """The documented commands work: the daemon reads the file, and the token of Prometheus may only read /metrics."""
        with tempfile.TemporaryDirectory() as folder:
            for name in 'etc/prometheus', 'etc/splatd':
                os.makedirs(os.path.join(folder, name))
            shutil.copy(os.path.join(FOLDER, 'package/splatd.conf'), folder + '/etc/splatd')
            commands = '\n'.join(line for line in re.findall(r'^#   (.*)$', read('splatd.service'), re.M) if 'systemctl' not in line)
            for old, new in ('/etc/', f'{folder}/etc/'), ('-o prometheus ', ''), ('chgrp splatd', 'true'):
                self.assertIn(old, commands)
                commands = commands.replace(old, new)
            subprocess.run(['sh', '-ec', commands], check=True, timeout=DEADLINE_S)
            scrape = model('prometheus.yml')['scrape_configs'][0]
            tokens, own = folder + '/etc/splatd/tokens', folder + scrape['authorization']['credentials_file']
            for path, hidden_from in (tokens, 0o027), (own, 0o077):
                self.assertEqual(os.stat(path).st_mode & hidden_from, 0, path)
            with open(tokens, encoding='utf-8') as f, open(own, encoding='utf-8') as g:
                first, prometheus = f.readline().split()[0], g.read()
            self.assertRegex(prometheus, r'^[A-Za-z0-9_-]{16,}$')
            with Daemon('--config', folder + '/etc/splatd/splatd.conf', '--token-file', tokens) as daemon:
                self.assertEqual([daemon.get('/metrics', prometheus)[0], daemon.get('/api/v1/volumes', prometheus)[0],
                                  daemon.get('/api/v1/volumes', first)[0]], [200, 403, 200])

    def test_wrong_settings_cause_no_restart(self):
        status = int(re.search(r'^RestartPreventExitStatus=(\d+)$', read('splatd.service'), re.M)[1])
        with tempfile.NamedTemporaryFile('w', suffix='.conf') as config:
            config.write('no-such-setting = 1\n')
            config.flush()
            for wrong in (['--config', config.name], ['--listen', 'nowhere'], ['--token-file', config.name]):
                done = subprocess.run([sys.argv[1], *wrong], capture_output=True, text=True, check=False, timeout=DEADLINE_S)
                self.assertEqual(done.returncode, status, done.stderr)

    def test_the_health_check_notices_a_stopped_daemon(self):
        """The health check of the image succeeds while a daemon runs and fails without one."""
        check = json.loads(re.search(r'^HEALTHCHECK .*?CMD (\[.*\])$', read('Containerfile'), re.M)[1])
        self.assertIn('/8080', check[-1])
        with Daemon() as daemon:
            check[-1] = check[-1].replace('/8080', f'/{daemon.port}')
            self.assertEqual(subprocess.run(check, capture_output=True, check=False, timeout=DEADLINE_S).returncode, 0)
        self.assertNotEqual(subprocess.run(check, capture_output=True, check=False, timeout=DEADLINE_S).returncode, 0)

    def test_the_image_copies_files_that_exist(self):
        """All files copied into the image are in its context, and it builds every program that run.sh installs."""
        with open(os.path.join(sys.argv[2], '.dockerignore'), encoding='utf-8') as f:
            ignored = {line.strip() for line in f if line.strip() and line[0] != '#'}
        copied = re.findall(r'^COPY (?!--from)(\S+) ', read('Containerfile'), re.M)
        self.assertIn('.', copied)
        for name in copied:
            self.assertTrue(os.path.exists(os.path.join(sys.argv[2], name)), name)
            self.assertNotIn(name.split('/')[0], ignored)
        parts = re.findall(r'^ *add_subdirectory\((\w+)\)', open_source('CMakeLists.txt'), re.M)
        self.assertEqual(ignored & set(parts), {'tests'})
        self.assertIn('-DSPLATD_TESTS=OFF', read('Containerfile'))
        self.assertLessEqual({'.git', 'build', '**/node_modules'}, ignored)
        built = re.search(r'--target (.*?) \\', read('Containerfile'))[1].split()
        self.assertEqual(set(built), set(re.search(r'^build release (.*)$', read('run.sh'), re.M)[1].split()) - {'splat-bench'})

    def test_every_library_has_a_package(self):
        """Each library that CMake finds with pkg-config belongs to a package of the list. Skipped without dpkg."""
        kinds = [line.split() for line in read('packages.txt').splitlines() if line and line[0] != '#']
        self.assertEqual(kinds, sorted(kinds))
        self.assertEqual({kind for kind, _ in kinds}, {'build', 'check', 'faster', 'package', 'peer', 'python', 'test'})
        self.assertEqual(len({name for _, name in kinds}), len(kinds))
        if not shutil.which('dpkg-query') or not shutil.which('pkg-config'):
            self.skipTest('no dpkg-query or pkg-config')
        for path in glob.glob(os.path.join(sys.argv[2], '**/CMakeLists.txt'), recursive=True):
            with open(path, encoding='utf-8') as f:
                modules = re.findall(r'pkg_check_modules\(\w+ (?:REQUIRED )?IMPORTED_TARGET (?:GLOBAL )?([^)]*)\)', f.read())
            for module in ' '.join(modules).split():
                module = re.split('[<>=]', module)[0]
                place = subprocess.run(['pkg-config', '--variable=pcfiledir', module], capture_output=True, text=True, check=False).stdout.strip()
                owner = subprocess.run(['dpkg-query', '-S', f'{place}/{module}.pc'], capture_output=True, text=True, check=False).stdout.split(':')[0]
                if owner:  # else no Debian package installed the library
                    self.assertIn(owner, {name for _, name in kinds} | DEPENDED, f'{module} of {path}')

    def test_systemd_accepts_the_units(self):
        """systemd-analyze accepts the units, where it is installed."""
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
