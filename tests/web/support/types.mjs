// SPDX-License-Identifier: Apache-2.0
// Checks the types of clients/web with TypeScript: `node types.mjs` prints the errors.
import path from 'node:path';
import { fileURLToPath, pathToFileURL } from 'node:url';

const ROOT = fileURLToPath(new URL('../../../clients/web/', import.meta.url));

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

/** The errors as lines of text. */
export async function typeErrors() {
  const { default: ts } = await import('typescript');
  const { config } = ts.readConfigFile(path.join(ROOT, 'tsconfig.json'), ts.sys.readFile);
  const { fileNames, options } = ts.parseJsonConfigFileContent(config, ts.sys, ROOT);
  return ts.getPreEmitDiagnostics(ts.createProgram(fileNames, options)).map(({ file, start, messageText }) => {
    const line = file ? file.getLineAndCharacterOfPosition(start).line + 1 : 0;
    return `${file ? path.relative(ROOT, file.fileName) : ''}:${line}: ${ts.flattenDiagnosticMessageText(messageText, ' ')}`;
  }).filter((text) => !NOT_A_BUG.some((pattern) => pattern.test(text)));
}

if (import.meta.url === pathToFileURL(process.argv[1] ?? '').href) console.log((await typeErrors()).join('\n'));
