// SPDX-License-Identifier: Apache-2.0
// Describes stream.policy for the user: one line for frames while the view moves, one for the frame at rest.

const REASONS = {
  quality: () => 'lower quality is faster',
  bandwidth: () => 'the network is too slow for larger images',
  time: ({ sharp_ms: sharp, budget_ms: budget }) =>
    (Number.isFinite(sharp) && Number.isFinite(budget)
      ? `full detail would take ${Math.round(sharp)} ms of a budget of ${Math.round(budget)} ms` : 'full detail would take too long'),
  unknown_time: () => 'the time for full detail is not known yet',
  shared_time: () => 'other sessions are moving, too',
  video_pixels: () => 'the video capacity is used up',
};

function describe({ format, quality, subsampling, size, coarse } = {}) {
  if (!format) return '';
  const parts = [format.toUpperCase() + (quality === undefined ? ', lossless' : `, quality ${quality}`)];
  if (subsampling) parts.push(`colours ${subsampling}`);
  if (size) parts.push(`${size[0]} × ${size[1]}`);
  if (coarse) parts.push(`${2 ** coarse}×${2 ** coarse}×${2 ** coarse} voxels as one`);
  return parts.join(', ');
}

/** policy: params of stream.policy, or null. */
export function policyText(policy) {
  const [moving, final] = [describe(policy?.moving), describe(policy?.final)];
  if (!moving || !final) return '';
  const why = (policy.why ?? []).filter((reason) => Object.hasOwn(REASONS, reason)).map((reason) => REASONS[reason](policy));
  return `Moving: ${moving}${why.length ? ` (${why.join('; ')})` : ''}\nAt rest: ${final}`;
}
