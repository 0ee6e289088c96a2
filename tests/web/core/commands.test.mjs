// SPDX-License-Identifier: Apache-2.0
// The commands are run by a shell, with programs that print what they get.
import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { test } from 'node:test';
import { curlCommand, fileName, quote, splatctlCommand } from '../../../clients/web/core/commands.js';

const BASE = 'http://127.0.0.1:8080/';
const NASTY = 'it\'s "$HOME" `id` \\ ! * ; & | # ~ größe\n{a,b} $(id) é';

/** Returns the arguments and the standard input that the program of a command gets. */
function run(command, env = {}) {
  const shell = `show() { printf '%s\\0' "$@"; printf 'stdin:'; cat; }\ncurl() { show "$@" </dev/null; }\nsplatctl() { show "$@"; }\n${command}`;
  const [stdin, ...args] = execFileSync('/bin/sh', ['-c', shell], { encoding: 'utf8', env: { PATH: process.env.PATH, ...env } }).split('\0').reverse();
  return { args: args.reverse(), stdin: stdin.slice('stdin:'.length) };
}

test('every text is one word of the shell, unchanged', () => {
  for (const text of ['', 'plain', NASTY, '\'', '\'\'', '-n', 'a\tb\n\n', '😀']) {
    assert.equal(execFileSync('/bin/sh', ['-c', `printf '%s' ${quote(text)}`], { encoding: 'utf8' }), text);
  }
});

test('curl gets the view, the token of the environment and a safe file name', () => {
  const view = { volume: NASTY, size: [10, 20] };
  const { args } = run(curlCommand(BASE, { view, format: 'png', quality: 90 }), { SPLATD_TOKEN: 'a "b"' });
  const value = (flag) => args[args.indexOf(flag) + 1];
  assert.equal(value('-H'), 'Authorization: Bearer a "b"');
  assert.deepEqual(JSON.parse(value('--data-binary')), view);
  assert.equal(value('-o'), 'it-s-HOME-id-größe-a-b-id-é.png');
  assert.equal(args.at(-1), `${BASE}api/v1/render?format=png`);
  const own = run(curlCommand(BASE, { view, format: 'jpeg', quality: 75 }, NASTY)).args;
  assert.ok(own.includes(`Authorization: Bearer ${NASTY}`));
  assert.equal(own.at(-1), `${BASE}api/v1/render?format=jpeg&quality=75`);
});

test('splatctl reads the view from its standard input', () => {
  const view = { volume: NASTY, size: [10, 20] };
  const { args, stdin } = run(splatctlCommand(BASE, { view, format: 'webp', quality: 60 }));
  assert.deepEqual(JSON.parse(stdin), view);
  assert.deepEqual(args, ['--url', BASE, 'render', '--view', '-', '--format', 'webp', '--quality', '60', '--out', 'it-s-HOME-id-größe-a-b-id-é.webp']);
  assert.ok(!splatctlCommand(BASE, { view, format: 'png' }).includes('--token'));
  assert.deepEqual(run(splatctlCommand(BASE, { view, format: 'exr' }, 'x y')).args.slice(0, 4), ['--url', BASE, '--token', 'x y']);
});

test('file names are safe and never empty or hidden', () => {
  assert.equal(fileName('engine', 'png'), 'engine.png');
  assert.equal(fileName('../../etc/passwd', 'png'), 'etc-passwd.png');
  assert.equal(fileName('-rf', 'png'), 'rf.png');
  assert.equal(fileName('///', 'exr'), 'view.exr');
  assert.equal(fileName('x'.repeat(300), 'png').length, 84);
});
