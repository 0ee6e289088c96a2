// SPDX-License-Identifier: Apache-2.0
// What this tab remembers over a reload. The browser may forbid storage; then the page works without it.

/** {recall(key) → text or null, remember(key, text)} for the page in the folder `base`. */
export function createStorage(base) {
  const place = `splatd:${new URL(base).pathname}`;
  return {
    recall(key) {
      try {
        return sessionStorage.getItem(`${place}${key}`);
      } catch {
        return null;
      }
    },
    remember(key, value) {
      try {
        sessionStorage.setItem(`${place}${key}`, value);
      } catch { /* see above */ }
    },
  };
}
