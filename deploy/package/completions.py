#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes completions of splatd and splatctl for bash, zsh and fish from --help.

  completions.py SPLATD SPLATCTL OUT_DIR

OUT_DIR gets bash/PROGRAM, zsh/_PROGRAM and fish/PROGRAM.fish.
"""
import os
import re
import sys

import help_text

BASH = r'''# Made from --help by deploy/package/completions.py
_@name@() {
    local word=${COMP_LINE:0:COMP_POINT} before=${COMP_WORDS[COMP_CWORD-1]} command='' words='' files='' i
    word=${word##*[[:space:]]}
    # In --name=value the shell sees three words.
    if [[ $word == --*=* ]]; then
        before=${word%%=*} word=${word#*=}
    fi
    for ((i = 1; i < COMP_CWORD; i++)); do
        case ${COMP_WORDS[i]} in
@commands@        esac
    done
    case "$command $before" in
@values@    *)
        case "$command" in
@options@        esac
        [[ $word != -* ]] || files=''
        ;;
    esac
    COMPREPLY=($(compgen -W "$words" -- "$word"))
    if [[ -n $files ]]; then
        compopt -o filenames
        COMPREPLY+=($(IFS=$'\n'; compgen "$files" -- "$word"))
    fi
    # Readline replaces only what stands behind the last colon.
    if [[ $word == *:* && $COMP_WORDBREAKS == *:* ]]; then
        COMPREPLY=("${COMPREPLY[@]#"${word%"${word##*:}"}"}")
    fi
}
complete -F _@name@ @name@
'''


def quoted(text):
    return "'" + text.replace("'", "'\\''") + "'"


class Completions:
    """What to complete for one program. `of` has the options of each command; a daemon has the one command ''."""

    def __init__(self, name, of, commands, demos):
        self.name, self.of, self.commands = name, of, commands
        self.demos = ['demo:' + demo for demo, _ in demos]
        self.arguments = {command.name: command.argument for command in reversed(commands)}

    def words(self, argument):
        """Fixed values of an argument, with the built-in volumes where a volume is meant."""
        return help_text.choices(argument) + (self.demos if help_text.kind(argument) == 'source' else [])

    def bash(self):
        letters = {'source': '-f', 'file': '-f', 'folder': '-d', '': ''}
        known = '|'.join(dict.fromkeys(command.name for command in self.commands))
        # The value of an option is no command: `--preset views`.
        commands = f'        {known}) [[ ${{COMP_WORDS[i-1]}} == --* ]] || command=${{command:-${{COMP_WORDS[i]}}}} ;;\n' if known else '        *) ;;\n'
        values = options = ''
        arguments = {}
        for command, entries in self.of.items():
            for entry in entries:
                if entry.argument:
                    arguments.setdefault(entry.name, {})[command] = entry.argument
        for name, by_command in arguments.items():
            same = len(set(by_command.values())) == 1
            for command, argument in list(by_command.items())[:1 if same else None]:
                values += (f'    {"*" if same else ""}"{"" if same else command} {name}") words={quoted(" ".join(self.words(argument)))}'
                           f' files={quoted(letters[help_text.kind(argument)])} ;;\n')
        for command, entries in self.of.items():
            argument = self.arguments.get(command, '')
            first = list(dict.fromkeys(c.name for c in self.commands)) if command == '' else self.words(argument)
            names = sorted({entry.name for entry in entries})
            options += (f'        {quoted(command)}) words={quoted(" ".join(first + names))}'
                        f' files={quoted(letters[help_text.kind(argument)])} ;;\n')
        text = BASH.replace('@name@', self.name).replace('@commands@', commands)
        return text.replace('@values@', values).replace('@options@', options)

    def zsh_action(self, argument):
        words = ' '.join(word.replace(':', '\\:') for word in self.words(argument))
        kind = help_text.kind(argument)
        if kind == 'source':
            return f'{{_alternative "demos:built-in volume:({words})" "files:file:_files"}}'.replace('\\:', '\\\\:')
        return f'({words})' if words else {'file': '_files', 'folder': '_files -/', '': ' '}[kind]

    def zsh_options(self, entries):
        lines = []
        for entry in entries:
            about = re.sub(r'([\[\]\\:])', r'\\\1', help_text.summary(entry.text))
            argument = re.sub(r'([\[\]\\:])', r'\\\1', entry.argument)
            value = f'=[{about}]:{argument}:{self.zsh_action(entry.argument)}' if entry.argument else f'[{about}]'
            lines.append('    ' + quoted(f'*{entry.name}{value}'))
        return lines

    def zsh(self):
        head = [f'#compdef {self.name}', '# Made from --help by deploy/package/completions.py']
        if not self.commands:
            return ' \\\n'.join(['\n'.join(head) + '\n_arguments'] + self.zsh_options(self.of[''])) + '\n'
        lines = head + ['local curcontext="$curcontext" state line', 'local -a commands', 'commands=(']
        for name in dict.fromkeys(command.name for command in self.commands):
            about = next(command.text for command in self.commands if command.name == name)
            lines.append('    ' + quoted(name + ':' + help_text.summary(about).replace(':', '\\:')))
        lines.append(')')
        lines.append(' \\\n'.join(['_arguments -C', *self.zsh_options(self.of['']), "    '1:command:->command'", "    '*::argument:->argument'"]))
        lines += ['case $state in', 'command) _describe command commands ;;', 'argument)', '    case $words[1] in']
        for command, entries in self.of.items():
            if command:
                kind = help_text.kind(self.arguments[command])
                rest = [f"    '*:{self.arguments[command].lower()}:{self.zsh_action(self.arguments[command])}'"] if kind else []
                lines.append(f'    {command})\n' + ' \\\n'.join(['    _arguments', *self.zsh_options(entries), *rest]) + '\n    ;;')
        return '\n'.join(lines + ['    esac', '    ;;', 'esac']) + '\n'

    def fish_value(self, argument):
        words, kind = ' '.join(self.words(argument)), help_text.kind(argument)
        if kind == 'folder':
            return " -x -a '(__fish_complete_directories)'"
        value = ' -r -F' if kind else ' -x'
        return value + (f' -a {quoted(words)}' if words else '')

    def fish(self):
        lines = ['# Made from --help by deploy/package/completions.py', f'complete -c {self.name} -f']
        for name in dict.fromkeys(command.name for command in self.commands):
            about = next(command.text for command in self.commands if command.name == name)
            lines.append(f'complete -c {self.name} -n __fish_use_subcommand -a {name} -d {self.fish_text(about)}')
        for command, entries in self.of.items():
            when = f' -n {quoted("__fish_seen_subcommand_from " + command)}' if command else ' -n __fish_use_subcommand' if self.commands else ''
            kind = help_text.kind(self.arguments.get(command, ''))
            if kind:
                words = ' '.join(self.words(self.arguments[command]))
                lines.append(f'complete -c {self.name}{when} -F' + (f' -a {quoted(words)}' if words else ''))
            for entry in entries:
                value = self.fish_value(entry.argument) if entry.argument else ''
                lines.append(f'complete -c {self.name}{when} -l {entry.name[2:]}{value} -d {self.fish_text(entry.text)}')
        return '\n'.join(lines) + '\n'

    @staticmethod
    def fish_text(text):
        return "'" + help_text.summary(text).replace('\\', '\\\\').replace("'", "\\'") + "'"

    def write(self, folder):
        for path, text in (f'bash/{self.name}', self.bash()), (f'zsh/_{self.name}', self.zsh()), (f'fish/{self.name}.fish', self.fish()):
            os.makedirs(os.path.join(folder, os.path.dirname(path)), exist_ok=True)
            with open(os.path.join(folder, path), 'w', encoding='utf-8') as file:
                file.write(text)


def main():
    daemon, control, folder = help_text.Daemon(sys.argv[1]), help_text.Control(sys.argv[2]), sys.argv[3]
    Completions('splatd', {'': daemon.options}, [], daemon.demos).write(folder)
    Completions('splatctl', {'': control.common, **control.of}, control.commands, daemon.demos).write(folder)


if __name__ == '__main__':
    main()
