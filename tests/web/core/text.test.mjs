// SPDX-License-Identifier: Apache-2.0
// The texts of the page: keys, placeholders, and that no other file of the page contains a text for the user.
import assert from 'node:assert/strict';
import { readFileSync, readdirSync } from 'node:fs';
import path from 'node:path';
import { fileURLToPath } from 'node:url';
import { test } from 'node:test';
import { LANGUAGES, chooseLanguage, hasText, t } from '../../../clients/web/core/text.js';
import { storedIcons, usedIcons } from '../../../clients/web/icons.mjs';
import { literals } from '../support/literals.mjs';
import { ENGLISH } from '../support/texts.mjs';

const { page: PAGE_TEXTS, panel: PANEL, shared: SHARED, ...PARTS } = ENGLISH;
const english = Object.assign({}, ...Object.values(ENGLISH));

const ROOT = fileURLToPath(new URL('../../../clients/web/', import.meta.url));
const scripts = (folder, recursive) => readdirSync(ROOT + folder, { recursive }).filter((name) => name.endsWith('.js')).map((name) => `${folder}/${name}`);
const SCRIPTS = ['app', 'core', 'element'].flatMap((folder) => scripts(folder, true));
const PAGE = readFileSync(`${ROOT}index.html`, 'utf8');

/** Runs `act` and returns what it reported to the console. */
function reports(act) {
  const said = [];
  const { error } = console;
  console.error = (text) => said.push(text);
  try {
    act();
  } finally {
    console.error = error;
  }
  return said;
}

test('a text takes its values; an unknown key or a missing value is reported', () => {
  assert.equal(t('curve.transfer.point', { number: 2, count: 5 }), 'Point 2 of 5');
  assert.deepEqual(reports(() => assert.equal(t('no.such.key'), 'no.such.key')), ['text: there is no text "no.such.key"']);
  assert.deepEqual(reports(() => assert.equal(t('curve.transfer.point', { number: 2 }), 'Point 2 of {count}')),
    ['text: "curve.transfer.point" needs a value for {count}']);
  assert.equal(hasText('toString'), false);
});

test('the language is the first wanted one that the page has, otherwise English', () => {
  assert.equal(chooseLanguage(['en-GB', 'en']), 'en');
  assert.equal(chooseLanguage(['tlh', 'xx-YY']), 'en');
  assert.equal(chooseLanguage([]), 'en');
  assert.equal(chooseLanguage(['../../evil']), 'en');
});

test('each language has a folder, with no key that English lacks and with the same placeholders', async () => {
  const names = (text) => (text.match(/\{\w+\}/g) ?? []).sort();
  assert.deepEqual(readdirSync(`${ROOT}text`).sort(), [...LANGUAGES].sort());
  for (const language of LANGUAGES.filter((name) => name !== 'en')) {
    const { default: texts } = await import(`../../../clients/web/text/${language}/index.js`);
    for (const [key, text] of Object.entries(texts)) {
      assert.ok(Object.hasOwn(english, key), `text/${language}/: English has no "${key}"`);
      assert.deepEqual(names(text), names(english[key]), `text/${language}/: "${key}"`);
    }
  }
});

/** Keys that the page uses, and the beginnings of computed ones: [{where, key} or {where, start}]. */
function uses() {
  const found = [...PAGE.matchAll(/data-(?:text|title|label|placeholder)="([^"]*)"/g)].map(([, key]) => ({ where: 'index.html', key }));
  for (const name of SCRIPTS) {
    for (const { text, line, isKey, isWhole } of literals(readFileSync(ROOT + name, 'utf8'))) {
      if (isKey) found.push(isWhole ? { where: `${name}:${line}`, key: text } : { where: `${name}:${line}`, start: text });
    }
  }
  // transfer_files.js has its own function for errors.
  for (const [, key] of readFileSync(`${ROOT}core/transfer_files.js`, 'utf8').matchAll(/\bfail\('([^']+)'/g)) {
    found.push({ where: 'core/transfer_files.js', key: `file.${key}` });
  }
  return found;
}

test('every key that the page uses exists', () => {
  const unknown = uses().filter(({ key, start }) => (key === undefined
    ? !Object.keys(english).some((name) => name.startsWith(start)) : !Object.hasOwn(english, key)));
  assert.deepEqual(unknown, []);
});

test('the texts are in order: keys with one beginning stand together, sorted; none is in two files', () => {
  for (const texts of Object.values(ENGLISH)) {
    const last = new Map();
    let before = '';
    for (const key of Object.keys(texts)) {
      const [start] = key.split('.');
      assert.ok(!last.has(start) || (start === before && key > last.get(start)), `"${key}" after "${last.get(start)}"`);
      last.set(start, key);
      before = start;
    }
  }
  assert.equal(Object.keys(english).length, Object.values(ENGLISH).reduce((sum, texts) => sum + Object.keys(texts).length, 0));
});

/** Returns `name` and all modules that it imports, also through others, without the modules that it loads later. */
function imported(name, modules = new Set()) {
  if (modules.has(name)) return modules;
  modules.add(name);
  for (const [, to] of readFileSync(ROOT + name, 'utf8').matchAll(/from '(\.[^']+)'/g)) imported(path.join(path.dirname(name), to), modules);
  return modules;
}

test('the page and its parts each have their own texts', () => {
  const page = imported('app/main.js');
  assert.ok(page.has('app/announce.js') && !page.has('app/parts/measure.js') && !page.has('app/measure/measures.js'));
  const isUsed = (name, { key, start }) => (key === undefined ? start && name.startsWith(start) : key === name);
  const usedBy = (name, found) => found.some((use) => isUsed(name, use));
  const all = uses();
  const first = all.filter(({ where }) => page.has(where.split(':')[0]));
  const later = new Set(); // the modules of all parts
  for (const [part, texts] of Object.entries(PARTS)) {
    assert.deepEqual(Object.keys(texts).filter((name) => usedBy(name, first)), [], `${part}: the page uses them`);
    const own = [...imported(`app/parts/${part}.js`)].filter((name) => !page.has(name));
    const wanted = all.filter(({ where }) => where === 'index.html' || own.includes(where.split(':')[0]));
    assert.deepEqual(Object.keys(texts).filter((name) => !usedBy(name, wanted)), [], `${part}: it uses none of them`);
    const known = { ...SHARED, ...PAGE_TEXTS, ...PANEL, ...texts };
    const missing = all.filter(({ where, key }) => own.includes(where.split(':')[0]) && key && !Object.hasOwn(known, key));
    assert.deepEqual(missing, [], `${part}: it lacks them`);
    for (const name of own) later.add(name);
  }
  const inPage = all.filter(({ where }) => where === 'index.html' || !later.has(where.split(':')[0]));
  const inParts = Object.keys(PARTS).map((part) => {
    const modules = imported(`app/parts/${part}.js`);
    return all.filter(({ where }) => later.has(where.split(':')[0]) && modules.has(where.split(':')[0]));
  });
  const lone = Object.keys({ ...PAGE_TEXTS, ...PANEL }).filter((name) => !usedBy(name, inPage) && inParts.filter((found) => usedBy(name, found)).length < 2);
  assert.deepEqual(lone, []);
});

test('the element carries its own texts and no others', () => {
  const modules = imported('element/splat-view.js');
  assert.ok(modules.has('app/camera/viewer.js') && modules.has('core/connection.js') && !modules.has('app/main.js'));
  const own = uses().filter(({ where }) => modules.has(where.split(':')[0]));
  const isOwn = (name) => own.some(({ key, start }) => (key === undefined ? start && name.startsWith(start) : key === name));
  assert.deepEqual(Object.keys(english).filter(isOwn).sort(), Object.keys(SHARED).sort());
});

test('every text is used', () => {
  const all = uses();
  const keys = new Set(all.map(({ key }) => key));
  const starts = all.map(({ start }) => start).filter((start) => start);
  const unused = Object.keys(english).filter((key) => !keys.has(key) && !starts.some((start) => key.startsWith(start)));
  assert.deepEqual(unused, []);
});

test('index.html has no text of its own, except the name and the line for browsers without JavaScript', () => {
  const body = PAGE.slice(PAGE.indexOf('<body>')).replace(/<noscript>.*?<\/noscript>/s, '').replace(/<!--.*?-->/gs, '');
  const texts = [...body.matchAll(/>([^<>]*[A-Za-z]{2}[^<>]*)</g)].map(([, text]) => text.trim()).filter((text) => text !== 'splatd');
  assert.deepEqual(texts, []);
  assert.deepEqual([...body.matchAll(/\s(?:title|aria-label|placeholder|alt)="([^"]+)"/g)].map(([, text]) => text), []);
});

// A text for the user has two words in a row, or begins with a capital letter. Errors about a broken peer and about bugs stay in
// English, because they are for the developers: the modules below throw nothing else.
const FOR_DEVELOPERS = ['core/frame.js', 'core/rpc.js', 'core/connection_state.js', 'core/vector.js', 'core/text.js',
  'element/example.js']; // a page of its own

const KEYS = /^(Arrow(Left|Right|Up|Down)|Page(Up|Down)|Escape|Home|End|Enter|Delete|Backspace|Tab|Shift)$/;
// Selectors, formats of files and headers, and messages about bugs.
const OTHERS = new Set([
  'input, select, textarea, dialog', 'input:not([type="range"], [type="checkbox"], [type="color"]), textarea, dialog',
  'Bearer …', 'Files', 'splatd transfer function', 'Step', 'Points', 'the page stopped', 'there is no stream', 'the worker that decodes images failed',
  'the answer is not a slice',
  'there is a mode … already', 'there is no mode …', 'there is a pane … already', 'there is no layout …', 'the key … is taken',
]);

test('no script contains a text for the user', () => {
  const wrong = [];
  for (const name of SCRIPTS.filter((script) => !FOR_DEVELOPERS.includes(script))) {
    for (const { text, line, before } of literals(readFileSync(ROOT + name, 'utf8'))) {
      const isShown = /\b[A-Za-z]{2,}[,;:]? [a-z]{2,}/.test(text) || /^[A-Z][a-z]+( |$)/.test(text);
      const isSelector = /(querySelector(All)?|closest|matches|matchMedia)(\?\.)?\($/.test(before) || /^([#.]\w|-H |\n:host)/.test(text);
      if (isShown && !isSelector && !KEYS.test(text) && !OTHERS.has(text)) wrong.push(`${name}:${line}: ${text}`);
    }
  }
  assert.deepEqual(wrong, []);
});

test('icons.svg has the icons that the page uses, and no others', () => {
  assert.deepEqual(storedIcons(), usedIcons());
});
