// SPDX-License-Identifier: Apache-2.0
// JSON merge patch (RFC 7396), on plain values.

const isObject = (value) => typeof value === 'object' && value !== null && !Array.isArray(value);

/** Applies `patch` to `target` without changing either. A member that is null in the patch is removed. */
export function applyPatch(target, patch) {
  if (!isObject(patch)) return patch;
  const result = isObject(target) ? { ...target } : {};
  for (const [key, value] of Object.entries(patch)) {
    if (value === null) delete result[key];
    else result[key] = applyPatch(result[key], value);
  }
  return result;
}

/** Combines two patches into one with the same effect. Like applyPatch, but null stays, because it means "default". */
export function joinPatches(first, second) {
  if (!isObject(first) || !isObject(second)) return second;
  const result = { ...first };
  for (const [key, value] of Object.entries(second)) {
    result[key] = key in result ? joinPatches(result[key], value) : value;
  }
  return result;
}

/** The patch from `from` to `to`. A member that is missing in `to` becomes null, which means "default" in a view. */
export function patchBetween(from, to) {
  const patch = {};
  for (const key of Object.keys(from)) if (!(key in to)) patch[key] = null;
  for (const [key, value] of Object.entries(to)) {
    if (JSON.stringify(value) === JSON.stringify(from[key])) continue;
    patch[key] = isObject(value) && isObject(from[key]) ? patchBetween(from[key], value) : value;
  }
  return patch;
}
