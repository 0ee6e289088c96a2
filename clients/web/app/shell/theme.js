// SPDX-License-Identifier: Apache-2.0
// Dark or light: as the system is, or as the user chose in this browser. data-theme of the document tells the style sheet.
// Colours of the style sheet for canvases are read once per theme: a computed style that is read while a drawing changes the document makes
// the browser compute all styles at once.
import { byId } from '../controls/dom.js';

const CHOICES = ['system', 'light', 'dark'];
const colors = new Map();
const listeners = new Set();
const scheme = window.matchMedia('(prefers-color-scheme: light)');
let choice = 'system';

function apply() {
  document.documentElement.dataset.theme = choice !== 'system' ? choice : scheme.matches ? 'light' : 'dark';
  colors.clear();
  for (const told of listeners) told();
}

/** Calls told() after each change of the theme. */
export const onTheme = (told) => listeners.add(told);

/** The value of a custom property such as '--text'. */
export function themeColor(name) {
  if (!colors.has(name)) colors.set(name, getComputedStyle(document.body).getPropertyValue(name).trim());
  return colors.get(name);
}

export function install({ base }) {
  const place = `splatd:${new URL(base).pathname}theme`;
  const select = byId('theme');
  try {
    choice = CHOICES.find((name) => name === localStorage.getItem(place)) ?? choice;
  } catch { /* storage is forbidden: the choice lasts as long as the page */ }
  select.value = choice;
  select.addEventListener('change', () => {
    choice = select.value;
    try {
      localStorage.setItem(place, choice);
    } catch { /* see above */ }
    apply();
  });
  apply();
}

scheme.addEventListener('change', apply);
apply();
