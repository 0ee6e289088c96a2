// SPDX-License-Identifier: Apache-2.0
// Colours of the style sheet for canvases. Each is read once per colour scheme: a computed style that is read while a drawing changes the
// document makes the browser compute all styles at once.
const colors = new Map();
const scheme = window.matchMedia('(prefers-color-scheme: light)');
scheme.addEventListener('change', () => colors.clear());

/** The value of a custom property such as '--text'. */
export function themeColor(name) {
  if (!colors.has(name)) colors.set(name, getComputedStyle(document.body).getPropertyValue(name).trim());
  return colors.get(name);
}
