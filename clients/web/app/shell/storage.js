// SPDX-License-Identifier: Apache-2.0
// What this tab remembers over a reload, and what the browser remembers longer. The browser may forbid storage; then the page works
// without it.

/** {recall(key) → text or null, remember(key, text), recallForever(key), rememberForever(key, text)} for the page in the folder `base`. */
export function createStorage(base) {
  const place = `splatd:${new URL(base).pathname}`;
  const get = (name, key) => {
    try {
      return window[name].getItem(`${place}${key}`);
    } catch {
      return null;
    }
  };
  const set = (name, key, value) => {
    try {
      window[name].setItem(`${place}${key}`, value);
    } catch { /* see above */ }
  };
  return {
    recall: (key) => get('sessionStorage', key),
    remember: (key, value) => set('sessionStorage', key, value),
    recallForever: (key) => get('localStorage', key),
    rememberForever: (key, value) => set('localStorage', key, value),
  };
}
