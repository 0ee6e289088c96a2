// SPDX-License-Identifier: Apache-2.0
// Gives the modules of core/ the texts of the page, as app/main.js and the parts do.
import { readdirSync } from 'node:fs';
import { useTexts } from '../../../clients/web/core/text.js';

const FOLDER = new URL('../../../clients/web/text/en/', import.meta.url);

/** The texts in English by file: page, panel, shared, and one for each part of the page. */
export const ENGLISH = {};
for (const file of readdirSync(FOLDER)) ENGLISH[file.replace('.js', '')] = (await import(new URL(file, FOLDER))).default;
for (const texts of Object.values(ENGLISH)) useTexts(texts);
