#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes the man pages splatd(1), splatd.conf(5) and splatctl(1) from --help.

  manual.py SPLATD SPLATCTL CHANGELOG OUT_DIR

The pages are compressed and depend only on these files, so that a build can be repeated. Their date is that of the version.
"""
import gzip
import os
import re
import sys
import textwrap

import help_text

FILES_OF_DAEMON = [
    ('/etc/splatd/splatd.conf', 'The settings of the service; see splatd.conf(5).'),
    ('/etc/splatd/tokens', 'The tokens of the service, with their roles and quotas; see splatd.conf(5).'),
    ('/var/lib/splatd', 'The state of the service: sessions, saved views, uploads and camera paths.')]
SIGNALS = [('SIGTERM, SIGINT', 'Drain and stop. A second signal exits at once.'),
           ('SIGHUP', 'Read tokens, certificate and log level again. Other settings wait for the next start.')]
ROLES = [
    ('admin', 'may do everything. It is the role of a line without role=.'),
    ('control', 'opens and uploads files, creates sessions, and controls its own.'),
    ('render', 'requests images, saves views and renders camera paths.'),
    ('view', 'reads volumes and saved views, and watches sessions.'),
    ('metrics', 'reads /metrics and nothing else.')]
VARIABLES = [('SPLATD_URL', 'The address of the daemon, with or without ?token=; --url replaces it.'),
             ('SPLATD_TOKEN', 'The token, if the address has none; --token replaces it.')]


def plain(text):
    """One line for roff, without a character that it would read as its own."""
    text = text.replace('\\', '\\e').replace('-', '\\-').replace("'", '\\(aq').replace('`', '\\(ga').replace('^', '\\(ha').replace('~', '\\(ti')
    text = ''.join(c if ord(c) < 128 else f'\\[u{ord(c):04X}]' for c in text)
    return '\\&' + text if text[:1] in ('.', '\\(aq') else text


def wrapped(text):
    return [plain(line) for line in textwrap.wrap(text, 72, break_long_words=False, break_on_hyphens=False)]


class Page:
    date = ''

    def __init__(self, name, section, version, summary):
        self.name, self.lines = f'{name}.{section}', []
        self.add(f'.TH {name.upper()} {section} {self.date} "splatd {version}" "{"File formats" if section == 5 else "User commands"}"')
        self.section('Name').add(f'{plain(name)} \\- {plain(summary)}')

    def add(self, *lines):
        self.lines += lines
        return self

    def section(self, title):
        return self.add(f'.SH {title.upper()}')

    def paragraph(self, text):
        return self.separate().add(*wrapped(text))

    def separate(self):
        return self if self.lines[-1].startswith('.S') else self.add('.PP')

    def entries(self, entries):
        """A list of (head, text). The first word of a head and its options are literal, the others placeholders."""
        for head, text in entries:
            words = head.split(' ')
            literal = [i == 0 or word.startswith('--') for i, word in enumerate(words)]
            self.add('.TP', ' '.join(f'\\fB{plain(word)}\\fR' if bold else plain(word) for word, bold in zip(words, literal)), *wrapped(text))
        return self

    def example(self, text):
        return self.separate().add('.EX', *map(plain, text.splitlines()), '.EE')

    def also(self, *pages):
        return self.section('See also').add(',\n'.join(f'.BR {name} ({number})' for name, number in pages).replace(',\n', ' ,\n'))

    def write(self, folder):
        text = '.\\" Made from --help by deploy/package/manual.py\n' + '\n'.join(self.lines) + '\n'
        with open(os.path.join(folder, self.name + '.gz'), 'wb') as file:
            file.write(gzip.compress(text.encode(), 9, mtime=0))


def heads(options):
    return [(f'{option.name} {option.argument}'.strip(), option.text) for option in options]


def splatd(daemon):
    page = Page('splatd', 1, daemon.version, 'render volumes and stream the images to browsers')
    page.section('Synopsis').add('.B splatd', '[OPTION...]')
    page.section('Description').paragraph(daemon.about.replace('\n', ' '))
    page.paragraph('The daemon listens on the loopback address with a random token unless it is told otherwise.')
    page.section('Options').entries(heads(daemon.options))
    page.section('Backends').entries(daemon.backends)
    page.section('Built-in volumes').paragraph('As demo:NAME or demo:NAME?size=N:').entries(daemon.demos)
    sizes, status = daemon.notes.split(' Exit status: ')
    page.section('Sizes').paragraph(sizes)
    page.section('Exit status').paragraph(status)
    page.section('Signals').entries((head.replace(' ', '\u00a0'), text) for head, text in SIGNALS)
    page.section('Files').entries(FILES_OF_DAEMON)
    page.section('Examples').example('splatd --volume demo:engine\nsplatd --data ~/ct --state ~/.local/state/splatd')
    return page.also(('splatctl', 1), ('splatd.conf', 5))


def splatd_conf(daemon):
    page = Page('splatd.conf', 5, daemon.version, 'settings and tokens of splatd')
    page.section('Synopsis').entries(FILES_OF_DAEMON[:2])
    page.section('Settings').paragraph(
        'Each line of splatd.conf is "key = value", empty, or a comment that begins with "#". A later line replaces an '
        'earlier one; only volume accumulates. "splatd --print-config" prints all settings in this form.')
    settings = [option for option in daemon.options if option.argument or option.name == '--require-gpu']
    page.entries((f'{option.name[2:]} = {option.argument or "yes|no"}', option.text) for option in settings if option.name != '--config')
    page.section('Tokens').paragraph(
        'Each line of the file of tokens is a token of 16 to 128 characters of A-Z, a-z, 0-9, ".", "_", "~" and "-", then words '
        '"key=value". "#" begins a comment. The daemon refuses a file that other users can change.')
    page.example('gY2qW0s8mB4x9Tz1 role=control name=ann sessions=4 fps=24\nQa1zX7c5Vn3m0Lk8 role=metrics name=prometheus')
    page.paragraph('The word role= gives the rights:').entries(ROLES)
    page.paragraph('The word name= names the owner of sessions, views and uploads: a new token for the same name keeps them. The other '
                   'words are quotas: sessions, snapshots, views, paths, path-bytes, upload-bytes, uploads, volumes, fps and '
                   'frame-size. The file /usr/share/doc/splatd/tokens.md describes them.')
    page.paragraph('After a change, "systemctl reload splatd" reads tokens, certificate and log level again, and '
                   '"systemctl restart splatd" all settings; with a state folder, sessions survive the restart.')
    return page.also(('splatd', 1),)


def splatctl(control):
    page = Page('splatctl', 1, control.version, 'control a splatd daemon, and render and convert volumes without one')
    page.section('Synopsis').add('.B splatctl', plain('[OPTION...] COMMAND [ARGUMENT...] [OPTION...]'))
    page.section('Description').paragraph(
        'splatctl loads volumes into a daemon, requests images, slices and camera paths, and manages saved views, presets and sessions. '
        'Without a daemon it renders (render --local), describes (info) and converts (convert) files.')
    page.section('Commands').entries((f'{c.name} {c.argument}'.strip(), c.text) for c in control.commands)
    page.section('Options')
    for block in control.blocks:
        page.add(f'.SS {plain(block.title)}').entries(block.options)
    page.section('Views').example(control.views)
    page.section('Exit status').paragraph(control.notes.partition(': ')[2])
    page.section('Environment').entries(VARIABLES)
    page.section('Examples').example(
        'splatctl load head.nrrd\n'
        'splatctl render --volume head --azimuth 90 --out side.png\n'
        'splatctl render --local --volume ~/ct/head.nrrd --out head.png\n'
        'splatctl convert ~/ct/series head.nii.gz')
    return page.also(('splatd', 1),)


def main():
    daemon, control, folder = help_text.Daemon(sys.argv[1]), help_text.Control(sys.argv[2]), sys.argv[4]
    with open(sys.argv[3], encoding='utf-8') as file:
        dates = dict(re.findall(r'^## \[([0-9.]+)\] - ([0-9-]+)$', file.read(), re.M))
    Page.date = dates[daemon.version]
    os.makedirs(folder, exist_ok=True)
    for page in splatd(daemon), splatd_conf(daemon), splatctl(control):
        page.write(folder)


if __name__ == '__main__':
    main()
