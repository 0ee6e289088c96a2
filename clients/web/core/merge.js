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

/** The patch that makes `to` of `from`: what is missing in `to` is null, which means "default" in a view. */
export function patchBetween(from, to) {
  const patch = {};
  for (const key of Object.keys(from)) if (!(key in to)) patch[key] = null;
  for (const [key, value] of Object.entries(to)) {
    if (JSON.stringify(value) === JSON.stringify(from[key])) continue;
    patch[key] = isObject(value) && isObject(from[key]) ? patchBetween(from[key], value) : value;
  }
  return patch;
}
