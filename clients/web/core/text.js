// SPDX-License-Identifier: Apache-2.0
// The texts of the page by key, in the language of the user. Each language has a folder text/LANGUAGE/ with files whose default exports are
// flat objects. English is complete and loads in parts: shared.js with <splat-view>, page.js and panel.js with the page, the others each with
// the part of app/parts/ of the same name. Other languages load index.js; a text that they lack appears in English.
import shared from '../text/en/shared.js';

/** The languages with a folder in text/. */
export const LANGUAGES = Object.freeze(['en']);

let english = shared;
let translated = {};
let texts = english;

/** The first of the wanted languages, such as ['de-AT', 'en'], that the page has; otherwise English. */
export function chooseLanguage(wanted) {
  const known = wanted.map((name) => String(name).toLowerCase().split('-')[0]);
  return known.find((name) => LANGUAGES.includes(name)) ?? 'en';
}

/** Adds English texts: the default export of a file in text/en/. */
export function useTexts(more) {
  english = { ...english, ...more };
  texts = { ...english, ...translated };
}

/** Uses another language where it has a text: the default export of its file. */
export function translate(other) {
  translated = other;
  texts = { ...english, ...translated };
}

export const hasText = (key) => Object.hasOwn(texts, key);

/**
 * The text of a key. Each {name} in it becomes values.name. An unknown key or a missing value is a bug: it is reported to the console,
 * which fails every test of the page, and the key or the placeholder appears instead.
 */
export function t(key, values = {}) {
  if (!hasText(key)) {
    console.error(`text: there is no text "${key}"`);
    return key;
  }
  return texts[key].replace(/\{(\w+)\}/g, (place, name) => {
    if (!Object.hasOwn(values, name)) {
      console.error(`text: "${key}" needs a value for ${place}`);
      return place;
    }
    return String(values[name]);
  });
}
