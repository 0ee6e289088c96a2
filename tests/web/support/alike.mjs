// SPDX-License-Identifier: Apache-2.0
// Compares every text and every control of two windows of a session.
import assert from 'node:assert/strict';
import { setTimeout } from 'node:timers/promises';
import { DEADLINE_MS } from './browser.mjs';

const POLL_MS = 50;

/** Parts that belong to one window or depend on its rights: participants and links, speed, and controls that need a token of the daemon. */
const OWN = ['#people-fold', '#status', '#stats', '#messages', '#notice', '#volumes', '#open-button', '#volumes-why', '#transfer-why', '#layer-add-elements',
  '#path', '#saved', '#saved-form', '#saved-note', '#preset-form', '#preset-row', '#capture-state'];

/** Runs in the page: [[name, fact], …] of all elements that can be seen. `own`: selectors of parts that are left out. */
function look(own) {
  // The layers of the overlay lie in the order in which the parts of the page came, so each layer is counted among the layers of its kind.
  const kindOf = ({ firstElementChild: first }) => first && `${first.localName} ${first.getAttribute('data-kind') ?? first.getAttribute('class') ?? ''}`;
  const placeOf = (element) => {
    const { parentElement: parent } = element;
    const isLayer = parent.id === 'overlay';
    const place = [...parent.children].filter((other) => !isLayer || kindOf(other) === kindOf(element)).indexOf(element);
    return isLayer ? `${kindOf(element)}:${place}` : place;
  };
  const nameOf = (element) => {
    const parts = [];
    let at = element;
    for (; at !== document.body && !at.id; at = at.parentElement) parts.unshift(`${at.localName}:${placeOf(at)}`);
    return [`#${at.id}`, ...parts].join(' ');
  };
  const facts = (element) => {
    const found = {};
    const text = [...element.childNodes].filter((node) => node.nodeType === Node.TEXT_NODE).map((node) => node.data.trim()).filter(Boolean).join(' ');
    if (text) found.text = text;
    for (const name of ['title', 'aria-label', 'aria-pressed', 'aria-valuetext', 'aria-current', 'placeholder', 'data-kind', 'data-state']) {
      if (element.hasAttribute(name)) found[name] = element.getAttribute(name);
    }
    if (element.matches('input, select, textarea')) {
      const { type, value, checked, min, max, step } = element;
      Object.assign(found, { value: type === 'checkbox' || type === 'radio' ? checked : value, min, max, step });
    }
    if (element.matches('button, input, select, textarea')) found.disabled = element.matches(':disabled');
    if (element.localName === 'option') found.disabled = element.disabled;
    return found;
  };
  return [...document.querySelectorAll('body *')].filter((element) => !element.closest(own) && element.checkVisibility({ visibilityProperty: true }))
    .map((element) => [nameOf(element), facts(element)]).filter(([, found]) => Object.keys(found).length > 0);
}

/** Resolves to the differences between two windows, one line each. isWatching: the guest may not change the view, so its controls may be disabled. */
async function differences(host, guest, isWatching) {
  const [a, b] = await Promise.all([host, guest].map((page) => page.evaluate(look, OWN.join())));
  const [before, after] = [new Map(a), new Map(b)];
  const isAlike = (name) => {
    const [mine, theirs] = [before.get(name), after.get(name)];
    const free = isWatching && mine?.disabled === false ? { disabled: theirs?.disabled } : {};
    return Boolean(mine && theirs) && JSON.stringify({ ...mine, ...free }) === JSON.stringify(theirs);
  };
  return [...new Set([...before.keys(), ...after.keys()])].filter((name) => !isAlike(name))
    .map((name) => `${name}\n  host  ${JSON.stringify(before.get(name))}\n  guest ${JSON.stringify(after.get(name))}`);
}

/** Waits until the guest shows all that the host shows. */
export async function alike(what, host, guest, { isWatching = false } = {}) {
  for (const end = performance.now() + DEADLINE_MS / 4; ;) {
    const found = await differences(host, guest, isWatching);
    if (found.length === 0) return;
    if (performance.now() > end) assert.fail(`${what}: ${found.length} differ\n${found.join('\n')}`);
    await setTimeout(POLL_MS);
  }
}
