// SPDX-License-Identifier: Apache-2.0
// Helpers for elements.
import { hasText, t } from '../../core/text.js';

const SVG = 'http://www.w3.org/2000/svg';

/** @type {(id: string) => any} */
export const byId = (id) => document.getElementById(id);

/**
 * Creates an element. text: its content; press(event): on click; children: elements or texts. Attributes that are false are omitted,
 * true gives an empty one. Buttons get type="button".
 */
export function make(tag, { text, press, ...attributes } = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) if (value !== false && value !== undefined) made.setAttribute(name, value === true ? '' : value);
  if (tag === 'button' && !attributes.type) made.type = 'button';
  if (text !== undefined) made.textContent = text;
  if (press) made.addEventListener('click', press);
  made.append(...children);
  return made;
}

/** Creates an SVG element. */
export function svg(tag, attributes = {}, ...children) {
  const made = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

/** True if what needs this part of core/kinds.js has a meaning for the picture. Without needs: always. */
export function isOffered(needs) {
  const { offers } = document.body.dataset;
  return !needs || offers === undefined || offers.split(' ').includes(needs);
}

/** An icon of icons.svg; it is hidden from screen readers, so its button needs a name. */
export function icon(name) {
  return svg('svg', { class: 'icon', 'aria-hidden': 'true', width: 18, height: 18 }, svg('use', { href: `icons.svg#${name}` }));
}

/** Sets a text only if it changes, because screen readers read every change aloud. */
export function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

/** Sets an attribute only if it changes, because the browser computes styles and names again even for the same value. */
export function setAttribute(element, name, value) {
  if (element.getAttribute(name) !== String(value)) element.setAttribute(name, value);
}

/** The parts of a text in which [Name] is a key of the keyboard. */
function withKeys(text) {
  return text.split(/\[([^\]]+)\]/).map((part, i) => (i % 2 ? make('kbd', { text: part }) : part));
}

const PLACES = {
  text: (element, text) => element.replaceChildren(...withKeys(text)),
  title: (element, text) => { element.title = text; },
  label: (element, text) => { element.setAttribute(element.tagName === 'OPTGROUP' ? 'label' : 'aria-label', text); },
  placeholder: (element, text) => { element.placeholder = text; },
};

/** Writes the texts of the current language into elements. PLACES lists the data attributes that hold their keys. `isWanted(key)` chooses the keys; by
 * default those whose texts are loaded. */
export function showTexts(root, isWanted = hasText) {
  for (const [name, set] of Object.entries(PLACES)) {
    for (const element of root.querySelectorAll(`[data-${name}]`)) if (isWanted(element.dataset[name])) set(element, t(element.dataset[name]));
  }
  for (const template of root.querySelectorAll('template')) showTexts(template.content, isWanted);
}
