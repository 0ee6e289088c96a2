#!/usr/bin/env node
// SPDX-License-Identifier: Apache-2.0
// Writes icons.svg: the icons of Lucide that index.html and app/ use.
//   npm install --prefix FOLDER lucide-static@1.62.0 && node clients/web/icons.mjs FOLDER/node_modules/lucide-static
import { readFileSync, readdirSync, writeFileSync } from 'node:fs';
import path from 'node:path';
import { fileURLToPath, pathToFileURL } from 'node:url';

const VERSION = '1.62.0';
const HERE = path.dirname(fileURLToPath(import.meta.url));
const USES = [/\bicon(?:: |\()'([a-z0-9-]+)'/g, /data-icon="([a-z0-9-]+)"/g];

/** The names of the icons that the page uses, sorted. */
export function usedIcons() {
  const scripts = readdirSync(path.join(HERE, 'app'), { recursive: true }).filter((name) => String(name).endsWith('.js'));
  const files = ['index.html', ...scripts.map((name) => `app/${name}`)];
  const names = files.map((name) => readFileSync(path.join(HERE, name), 'utf8'))
    .flatMap((text) => USES.flatMap((use) => [...text.matchAll(use)].map(([, name]) => name)));
  return [...new Set(names)].sort();
}

/** The names of the icons in icons.svg. */
export const storedIcons = () => [...readFileSync(path.join(HERE, 'icons.svg'), 'utf8').matchAll(/<symbol id="([^"]+)"/g)].map(([, id]) => id);

function write(folder) {
  const { version } = JSON.parse(readFileSync(path.join(folder, 'package.json'), 'utf8'));
  if (version !== VERSION) throw new Error(`${folder} has version ${version}; the icons are those of ${VERSION}`);
  const symbols = usedIcons().map((name) => {
    const text = readFileSync(path.join(folder, 'icons', `${name}.svg`), 'utf8');
    const shapes = text.slice(text.indexOf('>', text.indexOf('<svg')) + 1, text.indexOf('</svg>'));
    return `<symbol id="${name}" viewBox="0 0 24 24">${shapes.split('\n').map((line) => line.trim()).join('').replaceAll(' />', '/>')}</symbol>`;
  });
  const notice = `<!-- Icons of Lucide ${VERSION} (ISC); see LICENSES.md. Written by icons.mjs. -->`;
  writeFileSync(path.join(HERE, 'icons.svg'), `<svg xmlns="http://www.w3.org/2000/svg">\n${notice}\n${symbols.join('\n')}\n</svg>\n`);
}

if (import.meta.url === pathToFileURL(process.argv[1] ?? '').href) write(process.argv[2]);
