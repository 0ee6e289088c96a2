// SPDX-License-Identifier: Apache-2.0
// JSON merge patch (RFC 7396), on plain values.

const isObject = (value) => typeof value === 'object' && value !== null && !Array.isArray(value);

/** `target` with `patch` applied; neither is changed. Members that are null in the patch are removed. */
export function applyPatch(target, patch) {
  if (!isObject(patch)) return patch;
  const result = isObject(target) ? { ...target } : {};
  for (const [key, value] of Object.entries(patch)) {
    if (value === null) delete result[key];
    else result[key] = applyPatch(result[key], value);
  }
  return result;
}

/** One patch that does what `first` and then `second` do: as applyPatch, but null stays, since it means "default". */
export function joinPatches(first, second) {
  if (!isObject(first) || !isObject(second)) return second;
  const result = { ...first };
  for (const [key, value] of Object.entries(second)) {
    result[key] = key in result ? joinPatches(result[key], value) : value;
  }
  return result;
}
