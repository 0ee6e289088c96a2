// SPDX-License-Identifier: Apache-2.0
// Checks the types of a folder with a tsconfig.json: `node types.mjs [FOLDER]`, by default clients/web, prints `FILE:LINE: what` for
// each error and exits with status 1 if there are any, 77 without TypeScript.
import path from 'node:path';
import { fileURLToPath } from 'node:url';

const ROOT = path.resolve(process.argv[2] ?? fileURLToPath(new URL('../../clients/web/', import.meta.url)));

// TypeScript reads a destructured parameter ([x, y]) as a tuple, and the defaults of named options ({ title = true } = {}) as all that there
// are. URLSearchParams takes numbers. None of these is a bug.
const NOT_A_BUG = [
  /Argument of type '\w+\[\](\[\])*' is not assignable to parameter of type '\[/,
  /A spread argument must either have a tuple type/,
  /Target requires \d+ element\(s\) but source may have fewer/,
  /does not exist on type '\{( \w+\?: \w+;)* ?\}'/,
  /Object literal may only specify known properties, and '\w+' does not exist in type '\{ \w+\?: /,
  /is not assignable to parameter of type '\{ (\w+\??: \w+(\[\])?; )*\}'/,
  /is not assignable to parameter of type 'string \| Record<string, string> \| URLSearchParams/,
];

const ts = (await import('typescript').catch(() => null))?.default;
if (!ts) {
  console.log('skipped: no tests/node_modules/typescript (run npm ci in tests/)');
  process.exit(77);
}

/** The errors as lines of text. */
function typeErrors() {
  const { config } = ts.readConfigFile(path.join(ROOT, 'tsconfig.json'), ts.sys.readFile);
  const { fileNames, options } = ts.parseJsonConfigFileContent(config, ts.sys, ROOT);
  return ts.getPreEmitDiagnostics(ts.createProgram(fileNames, options)).map(({ file, start, messageText }) => {
    const line = file ? file.getLineAndCharacterOfPosition(start).line + 1 : 0;
    return `${file ? path.relative(ROOT, file.fileName) : ''}:${line}: ${ts.flattenDiagnosticMessageText(messageText, ' ')}`;
  }).filter((text) => !NOT_A_BUG.some((pattern) => pattern.test(text)));
}

const errors = typeErrors();
for (const error of errors) console.log(error);
process.exitCode = errors.length ? 1 : 0;
