// SPDX-License-Identifier: Apache-2.0
// The layout of the npm package in clients/web: what `npm pack` would contain, and the types made from the comments.
import assert from 'node:assert/strict';
import { execFileSync, spawnSync } from 'node:child_process';
import { existsSync, mkdtempSync, readFileSync, rmSync } from 'node:fs';
import { tmpdir } from 'node:os';
import path from 'node:path';
import { test } from 'node:test';
import { fileURLToPath } from 'node:url';

const ROOT = fileURLToPath(new URL('../../../clients/web/', import.meta.url));
const TSC = fileURLToPath(new URL('../../node_modules/typescript/bin/tsc', import.meta.url));
const NO_TSC = existsSync(TSC) ? false : 'no tests/node_modules/typescript: run npm ci in tests/';
const about = JSON.parse(readFileSync(`${ROOT}package.json`, 'utf8'));
const FORMATS = /\b(?:from|import)\s*\(?\s*'(\.[^']+)'|new URL\('([^']+\.js)', import\.meta\.url\)/g;

/** All modules that `name` needs, itself included. */
function needed(name, found = new Set()) {
  if (found.has(name)) return found;
  found.add(name);
  for (const [, module, worker] of readFileSync(ROOT + name, 'utf8').matchAll(FORMATS)) {
    needed(path.posix.join(path.posix.dirname(name), module ?? worker), found);
  }
  return found;
}

test('the package contains the element, all that it needs, and nothing of the page', () => {
  const [{ files }] = JSON.parse(execFileSync('npm', ['pack', '--dry-run', '--json', '--ignore-scripts'], { cwd: ROOT, encoding: 'utf8', stdio: ['ignore', 'pipe', 'ignore'] }));
  const names = files.map((file) => file.path);
  const missing = [...needed('element/splat-view.js')].filter((name) => !names.includes(name));
  assert.deepEqual(missing, []);
  for (const name of ['package.json', 'README.md', 'LICENSES.md']) assert.ok(names.includes(name), name);
  assert.deepEqual(names.filter((name) => /^app\/main\.js|index\.html|example|tsconfig/.test(name)), []);
});

test('the package has the version of the daemon, and its entry exists', () => {
  const header = readFileSync(new URL('../../../renderer/include/sp/version.h', import.meta.url), 'utf8');
  const version = ['MAJOR', 'MINOR', 'PATCH'].map((part) => new RegExp(`SP_VERSION_${part}\\s+(\\d+)`).exec(header)[1]).join('.');
  assert.equal(about.version, version);
  assert.ok(existsSync(path.join(ROOT, about.exports['.'].default)));
});

test('the declarations of the element name its properties, methods and class', { skip: NO_TSC }, () => {
  const folder = mkdtempSync(path.join(tmpdir(), 'splat-view-'));
  try {
    // Errors are the matter of lint.types; the compiler writes the declarations all the same.
    spawnSync(process.execPath, [TSC, '-p', ROOT, '--noEmit', 'false', '--declaration', '--emitDeclarationOnly', '--outDir', folder]);
    const text = readFileSync(path.join(folder, about.types.replace('./types/', '')), 'utf8');
    for (const part of ['class SplatView extends HTMLElement', 'set url(', 'set controls(', 'get state()', 'change(patch', 'toBlob(']) assert.ok(text.includes(part), part);
  } finally {
    rmSync(folder, { recursive: true });
  }
});
