# SPDX-License-Identifier: Apache-2.0
"""Reads the output of --help of splatd and splatctl, the one place where their options are listed.

manual.py makes man pages from it and completions.py completions of shells.
"""
import collections
import re
import subprocess
import textwrap

Option = collections.namedtuple('Option', 'name argument text')  # "--volume", "PATH|demo:NAME" or "", a paragraph
Command = collections.namedtuple('Command', 'name argument text')  # "load", "SOURCE", a paragraph
Block = collections.namedtuple('Block', 'title options')  # "render", [(head, text)]

COLUMN = 26  # of the texts of splatctl


def output(*command):
    return subprocess.run(command, capture_output=True, text=True, check=True, encoding='utf-8').stdout


def options_of(head, text):
    """"--origin X,Y,Z --normal X,Y,Z" has two options."""
    return [Option(name, argument, text) for name, argument in re.findall(r'(--[a-z-]+)(?: ([^-\s]\S*))?', head)]


def entries(lines):
    """Yields (head, text) of "  head  text" lines, whose text continues in column 26."""
    head, text = '', []
    for line in lines:
        if line.startswith(' ' * COLUMN):
            text.append(line.strip())
            continue
        if head:
            yield head, ' '.join(text)
        parts = re.split(r'  +', line.strip(), maxsplit=1)
        head, text = parts[0], parts[1:]
    if head:
        yield head, ' '.join(text)


class Daemon:
    """The help of splatd: `about`, `options`, the tables `backends` and `demos` of (name, text), and `notes`."""

    def __init__(self, program):
        self.version = output(program, '--version').split()[1]
        text = output(program, '--help')
        _, self.about, rest = text.split('\n\n', 2)
        options, backends, demos, notes = rest.split('\n\n')
        self.options = []
        for head, body in re.findall(r'^  (--.*)\n((?: {8}.*(?:\n|$))+)', options, re.M):
            self.options += options_of(head, ' '.join(line.strip() for line in body.splitlines()))
        self.backends, self.demos = self.table(backends), self.table(demos)
        self.notes = notes.strip().replace('\n', ' ')

    @staticmethod
    def table(block):
        return [tuple(line.split(None, 1)) for line in block.splitlines()[1:]]


class Control:
    """The help of splatctl: `commands`, `blocks` of options, `views` (free text), `notes`, and `of[command]`: its options."""

    def __init__(self, program):
        self.version = output(program, '--version').split()[1]
        parts = output(program, '--help').rstrip('\n').split('\n\n')
        self.commands = [Command(*(head.split(' ', 1) + [''])[:2], text) for head, text in entries(parts[1].splitlines()[1:])]
        self.blocks, self.views, self.notes = self.read_blocks(parts[2:])
        self.of = {}
        for command in self.commands:
            blocks = self.read_blocks(output(program, command.name, '--help').rstrip('\n').split('\n\n')[2:])[0]
            self.of[command.name] = [option for block in blocks for entry in block.options for option in options_of(*entry)]
        # What may stand before the command.
        self.common = [option for block in self.blocks if block.title in ('The daemon', 'Everywhere')
                       for entry in block.options for option in options_of(*entry)]

    @staticmethod
    def read_blocks(parts):
        blocks, views, notes = [], '', ''
        for part in parts:
            lines = part.splitlines()
            if len(lines) > 1 and lines[1].startswith('  --'):
                blocks.append(Block(lines[0].rstrip(':'), list(entries(lines[1:]))))
            elif len(lines) > 1:
                views = part
            else:
                notes = part
        return blocks, views, notes


def choices(argument):
    """The fixed values of "auto|gl|cpu", or "magnitude" of "magnitude|ID|SOURCE"."""
    return [word for word in argument.split('|') if re.fullmatch('[a-z0-9][a-z0-9-]*', word)]


def kind(argument):
    """What the shell completes: "source" (files and built-in volumes), "file", "folder" or ""."""
    words = set(re.findall('[A-Z]+|demo:', argument))
    if words & {'SOURCE', 'demo:'}:
        return 'source'
    if words & {'FILE', 'PATH'}:
        return 'file'
    return 'folder' if words & {'DIR', 'FOLDER'} else ''


def summary(text):
    """The first sentence without its default, for a list of options."""
    text = re.sub(r' \(default[^)]*\)', '', text)
    first = re.split(r'(?<=[a-z)])[.;:](?: |$)', text)[0]
    return first if len(first) <= 80 else textwrap.wrap(first, 78)[0] + ' …'
