# SPDX-License-Identifier: Apache-2.0
"""Installs the daemon as `cmake --install` does and looks at what is there: programs, service, man pages, completions, versions.

`deploy/package.sh --check` tests the Debian package, which is made of the same files.
"""
import gzip
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import unittest
import urllib.request

SOURCE, BUILD, CMAKE = os.environ['SPLATD_SOURCE'], os.environ['SPLATD_BUILD'], os.environ['CMAKE']
DEADLINE_S = 60
sys.path.insert(0, os.path.join(SOURCE, 'deploy/package'))
sys.dont_write_bytecode = True
import help_text  # noqa: E402  pylint: disable=wrong-import-position

# Asks the completion of bash as readline does: a line, and the words that follow.
ASK = r'''
source "$1"; shift
compopt() { :; }
COMP_LINE=$1 COMP_POINT=${#1}
read -ra COMP_WORDS <<<"$COMP_LINE"
[[ $COMP_LINE != *' ' ]] || COMP_WORDS+=('')
COMP_CWORD=$((${#COMP_WORDS[@]} - 1))
_${COMP_WORDS[0]}
printf '%s\n' "${COMPREPLY[@]}"
'''


def run(*command, **options):
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=DEADLINE_S, **options)
    if done.returncode:
        raise AssertionError(f'{" ".join(command)}: exit status {done.returncode}\n{done.stdout}{done.stderr}')
    return done.stdout


def read(*path):
    with open(os.path.join(*path), encoding='utf-8') as file:
        return file.read()


class Runtime(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.mkdtemp(prefix='splatd-install-')
        cls.addClassCleanup(shutil.rmtree, cls.folder)
        # As a package does; then below a prefix that moves.
        cls.root, cls.prefix = os.path.join(cls.folder, 'root'), os.path.join(cls.folder, 'moved')
        run(CMAKE, '--install', BUILD, '--prefix', '/usr', '--component', 'runtime', env=dict(os.environ, DESTDIR=cls.root))
        cls.first = os.path.join(cls.folder, 'first')
        run(CMAKE, '--install', BUILD, '--prefix', cls.first, '--component', 'runtime')
        os.rename(cls.first, cls.prefix)
        cls.share = os.path.join(cls.root, 'usr/share')
        cls.splatd, cls.splatctl = (os.path.join(cls.prefix, 'bin', name) for name in ('splatd', 'splatctl'))

    def test_the_files_have_their_places_and_headers_are_left_out(self):
        names = {os.path.relpath(os.path.join(at, name), self.root) for at, _, names in os.walk(self.root) for name in names}
        for name in ('usr/bin/splatd', 'usr/bin/splatctl', 'usr/lib/splatd/splat-import', 'usr/lib/splatd/splat-exr.so', 'etc/splatd/splatd.conf',
                     'usr/lib/systemd/system/splatd.service', 'usr/lib/sysusers.d/splatd.conf', 'usr/share/man/man1/splatd.1.gz',
                     'usr/share/man/man1/splatctl.1.gz', 'usr/share/man/man5/splatd.conf.5.gz', 'usr/share/doc/splatd/copyright',
                     'usr/share/doc/splatd/changelog.gz', 'usr/share/doc/splatd/tokens.md'):
            self.assertIn(name, names)
        self.assertEqual([name for name in names if re.search(r'\.(h|a|pc|cmake)$|libsplat', name)], [])

    def test_a_moved_installation_renders_a_file(self):
        n, data, image = 8, os.path.join(self.folder, 'ramp.nrrd'), os.path.join(self.folder, 'ramp.png')
        with open(data, 'wb') as file:
            file.write(f'NRRD0004\ntype: uint8\ndimension: 3\nsizes: {n} {n} {n}\nencoding: raw\n\n'.encode() + bytes(i % 256 for i in range(n ** 3)))
        run(self.splatctl, 'render', '--local', '--backend', 'cpu', '--volume', data, '--size', '32x32', '--out', image)
        with open(image, 'rb') as file:
            self.assertEqual(file.read(8), b'\x89PNG\r\n\x1a\n')

    def test_the_service_starts_what_is_installed(self):
        """Below /usr the unit has the paths of packages, below another prefix those of the prefix; the daemon accepts the configuration."""
        for unit, prefix, etc in ((read(self.root, 'usr/lib/systemd/system/splatd.service'), '/usr', '/etc'),
                                  (read(self.prefix, 'lib/systemd/system/splatd.service'), self.first, self.first + '/etc')):
            start = re.search('^ExecStart=(.*)$', unit, re.M)[1].split()
            self.assertEqual(start[0], prefix + '/bin/splatd')
            self.assertEqual(start[start.index('--token-file') + 1], etc + '/splatd/tokens')
            self.assertEqual(start[start.index('--config') + 1], etc + '/splatd/splatd.conf')
            self.assertEqual(re.search('^User=(.*)$', unit, re.M)[1], re.search('^u (.*?) ', read(SOURCE, 'deploy/package/sysusers.conf'), re.M)[1])
        config = os.path.join(self.prefix, 'etc/splatd/splatd.conf')
        self.assertIn('listen = 127.0.0.1:8080\n', run(self.splatd, '--config', config, '--print-config'))
        with open(os.path.join(self.folder, 'all.conf'), 'w', encoding='utf-8') as file:
            file.write(re.sub(r'^#(?=[a-z-]+ = )', '', read(config), flags=re.M))
        self.assertIn('volume = demo:engine\n', run(self.splatd, '--config', file.name, '--print-config'))

    def test_a_second_installation_keeps_the_configuration(self):
        prefix = os.path.join(self.folder, 'twice')
        config = os.path.join(prefix, 'etc/splatd/splatd.conf')
        os.makedirs(os.path.dirname(config))
        with open(config, 'w', encoding='utf-8') as file:
            file.write('threads = 3\n')
        run(CMAKE, '--install', BUILD, '--prefix', prefix, '--component', 'runtime')
        self.assertEqual(read(config), 'threads = 3\n')

    def test_man_pages_have_all_options(self):
        daemon, control = help_text.Daemon(self.splatd), help_text.Control(self.splatctl)
        options = {option.name for entries in control.of.values() for option in entries}
        self.assertGreater(len(options), 30)
        self.assertEqual({name for name, _ in daemon.backends}, set(help_text.choices(next(o.argument for o in daemon.options if o.name == '--backend'))))
        for page, names in (('man1/splatd.1', {o.name for o in daemon.options}), ('man1/splatctl.1', options | {c.name for c in control.commands}),
                            ('man5/splatd.conf.5', {o.name[2:] for o in daemon.options if o.argument} - {'config'})):
            path = os.path.join(self.share, 'man', page + '.gz')
            with gzip.open(path, 'rt', encoding='utf-8') as file:
                text = file.read()
            for name in names:
                self.assertIn('\\fB' + name.replace('-', '\\-'), text, page)
            plain = os.path.join(self.folder, os.path.basename(page))
            with open(plain, 'w', encoding='utf-8') as file:
                file.write(text)
            for checker in ['mandoc', '-Tlint', '-Wwarning'], ['man', '--warnings', '-l', '-Tutf8']:
                if shutil.which(checker[0]):
                    done = subprocess.run([*checker, plain], capture_output=True, text=True, check=False, timeout=DEADLINE_S,
                                          env=dict(os.environ, MANPAGER='cat', LC_ALL='C.UTF-8'))
                    self.assertEqual((done.returncode, done.stderr), (0, ''), (checker, done.stdout[:500]))

    def test_shells_accept_the_completions(self):
        count = 0
        for shell, pattern in (('bash', 'bash-completion/completions/{}'), ('zsh', 'zsh/{}/_{}'), ('fish', 'fish/vendor_completions.d/{}.fish')):
            if not shutil.which(shell):
                print(f'no {shell}: its completions are not checked')
                continue
            for program in 'splatd', 'splatctl':
                zsh = next(iter(os.listdir(os.path.join(self.share, 'zsh'))))
                path = os.path.join(self.share, pattern.format(*([zsh] if shell == 'zsh' else []), program))
                self.assertEqual(run(shell, '-n', path), '')
                count += 1
        self.assertGreaterEqual(count, 2)

    def test_bash_completes_names_values_and_files(self):
        work = os.path.join(self.folder, 'work')
        os.makedirs(work + '/engine-folder')
        with open(work + '/engine.nrrd', 'w', encoding='utf-8'):
            pass
        for line, answers in (
                ('splatctl ren', ['render']), ('splatctl render --backend g', ['gl', 'gl-software']), ('splatctl slice --format ', ['jpeg', 'png', 'raw']),
                ('splatctl measures --format ', ['csv']), ('splatctl --preset views ren', ['render']), ('splatctl load demo:tu', ['turbulence']),
                ('splatctl info eng', ['engine-folder', 'engine.nrrd']), ('splatctl preset views --del', ['--delete']), ('splatctl info --del', ['']),
                ('splatd --log-level=w', ['warn']), ('splatd --data eng', ['engine-folder']), ('splatd --volume eng', ['engine-folder', 'engine.nrrd']),
                ('splatd --require-', ['--require-gpu'])):
            program = line.split()[0]
            answer = run('bash', '-c', ASK, 'bash', os.path.join(self.share, 'bash-completion/completions', program), line, cwd=work)
            self.assertEqual(sorted(answer.splitlines()), answers, line)

    def test_the_version_is_the_same_everywhere(self):
        version = '.'.join(re.findall(r'#define SP_VERSION_(?:MAJOR|MINOR|PATCH) (\d+)', read(SOURCE, 'renderer/include/sp/version.h')))
        found = {
            'splatd': run(self.splatd, '--version').split()[1], 'splatctl': run(self.splatctl, '--version').split()[1],
            'npm package': json.loads(read(SOURCE, 'clients/web/package.json'))['version'],
            'contract': re.search(r'^  version: (.*)$', read(SOURCE, 'protocol/openapi.yaml'), re.M)[1],
            'changelog': re.search(r'^## \[([0-9.]+)\]', read(SOURCE, 'CHANGELOG.md'), re.M)[1],
            'man page': gzip.decompress(self.bytes_of('man/man1/splatd.1.gz')).decode().split('"splatd ')[1].split('"')[0],
            'pkg-config': re.search('^Version: (.*)$', read(BUILD, 'renderer/splat.pc'), re.M)[1]}
        child = subprocess.Popen([self.splatd, '--listen', '127.0.0.1:0', '--backend', 'null'], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        try:
            url = child.stdout.readline().split()[-1]
            with urllib.request.urlopen(url.split('?')[0] + 'readyz', timeout=DEADLINE_S) as answer:
                found['running daemon'] = json.load(answer)['version']
        finally:
            child.terminate()
            child.wait(DEADLINE_S)
            child.stdout.close()
        self.assertEqual(found, dict.fromkeys(found, version))

    def bytes_of(self, name):
        with open(os.path.join(self.share, name), 'rb') as file:
            return file.read()

    def test_the_licences_of_others_are_installed(self):
        """Each file that LICENSES.md names as the work of others is in the copyright file, and no name there is stale."""
        text = self.bytes_of('doc/splatd/copyright').decode()
        named = ' '.join(re.findall('^Files: (.*)$', text, re.M)).split()
        for name in named:
            self.assertTrue(name == '*' or os.path.exists(os.path.join(SOURCE, name)), name)
        titles = ' '.join(re.findall('^## (.*)$', read(SOURCE, 'clients/web/LICENSES.md'), re.M))
        for name in re.findall('`(.*?)`', titles):
            self.assertTrue(name in named or 'clients/web/' + name in named, name)
        for license_name in ' and '.join(re.findall('^License: (.*)$', text, re.M)).split(' and '):
            self.assertRegex(text, f'(?m)^License: {re.escape(license_name)}\n ')


if __name__ == '__main__':
    unittest.main()
