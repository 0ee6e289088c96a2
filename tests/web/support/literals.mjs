// SPDX-License-Identifier: Apache-2.0
// Finds the string literals of a script.

const BEFORE_REGEX = /(?:^|[(,=:[!&|?{};+\-*%<>~^]|\b(?:return|typeof|case|in|of|do|else))\s*$/;

/**
 * The literals of a script, without comments: [{text, line, before, isKey, isWhole}]. A template is one literal, in which each
 * expression becomes "…"; the literals of its expressions follow. before: the code in front of it, up to 40 characters. isKey: an
 * argument of t(), or one of the two results of a condition in it. isWhole: a key without expressions; otherwise text is its beginning.
 */
export function literals(source) {
  const found = [];
  read(source, 0, '', found);
  return found.map(({ at, ...literal }) => ({ ...literal, line: source.slice(0, at).split('\n').length }));
}

/** Reads code from `at` to the unmatched `end` or to the end of the source. Returns the index after it. */
function read(source, at, end, found) {
  const depth = [];
  for (let i = at; i < source.length; i += 1) {
    const c = source[i];
    if (c === '/' && source[i + 1] === '/') {
      i = source.indexOf('\n', i);
      if (i < 0) return source.length;
    } else if (c === '/' && source[i + 1] === '*') {
      i = source.indexOf('*/', i) + 1;
    } else if (c === '/' && BEFORE_REGEX.test(source.slice(Math.max(0, i - 20), i))) {
      i = regex(source, i);
    } else if (c === "'" || c === '"') {
      i = string(source, i, found);
    } else if (c === '`') {
      i = template(source, i, found);
    } else if (c === '{') {
      depth.push(c);
    } else if (c === '}') {
      if (end === '}' && depth.length === 0) return i;
      depth.pop();
    }
  }
  return source.length;
}

function regex(source, at) {
  let isClass = false;
  for (let i = at + 1; i < source.length; i += 1) {
    if (source[i] === '\\') i += 1;
    else if (source[i] === '[') isClass = true;
    else if (source[i] === ']') isClass = false;
    else if (source[i] === '/' && !isClass) return i;
  }
  return source.length;
}

function note(found, source, at, text, isWhole, start = text) {
  const before = source.slice(Math.max(0, at - 120), at);
  const isKey = /\bt\((?:[^;,{]*\?\s*)?$/.test(before) || /\bt\([^;,{]*\?\s*'[^']*'\s*:\s*$/.test(before);
  found.push({ at, text: isKey ? start : text, before: before.slice(-40), isKey, isWhole });
}

function string(source, at, found) {
  let text = '';
  for (let i = at + 1; i < source.length; i += 1) {
    if (source[i] === '\\') {
      i += 1;
      text += source[i];
    } else if (source[i] === source[at]) {
      note(found, source, at, text, true);
      return i;
    } else {
      text += source[i];
    }
  }
  throw new Error(`a string without an end at ${at}`);
}

function template(source, at, found) {
  let text = '';
  let start = null;
  const inner = [];
  for (let i = at + 1; i < source.length; i += 1) {
    if (source[i] === '\\') {
      i += 1;
      text += source[i];
    } else if (source[i] === '`') {
      note(found, source, at, text, start === null, start ?? text);
      found.push(...inner);
      return i;
    } else if (source[i] === '$' && source[i + 1] === '{') {
      start ??= text;
      i = read(source, i + 2, '}', inner);
      text += '…';
    } else {
      text += source[i];
    }
  }
  throw new Error(`a template without an end at ${at}`);
}
