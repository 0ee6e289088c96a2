// SPDX-License-Identifier: Apache-2.0
// Commands for a POSIX shell that render the view of the page: with curl, and with splatctl. The token is left out unless it is
// given: the commands then take it from $SPLATD_TOKEN.

/** Quotes any text without U+0000 as one word of a POSIX shell. */
export function quote(text) {
  return /^[A-Za-z0-9_./:=@%+-]+$/.test(text) ? text : `'${text.replaceAll('\'', '\'\\\'\'')}'`;
}

/** A file name without characters that are special in a shell or in a file system: "a b/c" → "a-b-c". */
export function fileName(name, format) {
  const safe = name.normalize('NFC').replace(/[^\p{L}\p{N}._-]+/gu, '-').replace(/^[-.]+|-+$/g, '').slice(0, 80);
  return `${safe || 'view'}.${format}`;
}

const isLossy = (format) => format === 'jpeg' || format === 'webp';

/** The query of POST /render. */
export function renderQuery({ format, quality }) {
  return String(new URLSearchParams({ format, ...(isLossy(format) ? { quality } : {}) }));
}

/** base: address of the daemon with a slash at its end; image: {view, format, quality}; token: '' = from the environment. */
export function curlCommand(base, { view, format, quality }, token = '') {
  const header = token ? quote(`Authorization: Bearer ${token}`) : '"Authorization: Bearer $SPLATD_TOKEN"';
  return [
    `curl --fail-with-body --silent --show-error -H ${header}`,
    '-H \'Content-Type: application/json\'',
    `--data-binary ${quote(JSON.stringify(view))}`,
    `-o ${quote(fileName(view.volume, format))} ${quote(`${base}api/v1/render?${renderQuery({ format, quality })}`)}`,
  ].join(' \\\n  ');
}

/** As curlCommand(). */
export function splatctlCommand(base, { view, format, quality }, token = '') {
  const lossy = isLossy(format) ? ` --quality ${quality}` : '';
  return [
    `printf %s ${quote(JSON.stringify(view))} |`,
    `splatctl --url ${quote(base)}${token ? ` --token ${quote(token)}` : ''} render --view - --format ${format}${lossy}`,
    `--out ${quote(fileName(view.volume, format))}`,
  ].join(' \\\n  ');
}
