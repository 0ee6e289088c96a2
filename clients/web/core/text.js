// SPDX-License-Identifier: Apache-2.0
// The texts of the page by key, in the language of the user. Each language has one file text/LANGUAGE.js, whose default export is a
// flat object. English is complete; a text that another language lacks appears in English. It has two files, so that <splat-view> carries
// only the texts that it needs.
import shared from '../text/shared/en.js';

/** The languages with a file in text/. */
export const LANGUAGES = Object.freeze(['en']);

let texts = shared;

/** The first of the wanted languages, such as ['de-AT', 'en'], that the page has; otherwise English. */
export function chooseLanguage(wanted) {
  const known = wanted.map((name) => String(name).toLowerCase().split('-')[0]);
  return known.find((name) => LANGUAGES.includes(name)) ?? 'en';
}

/** Adds the texts of the page, then those of another language: the default export of its file. */
export function useTexts(other) {
  texts = { ...texts, ...other };
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
