// SPDX-License-Identifier: Apache-2.0
// Certificates of tests.
import { execFileSync } from 'node:child_process';
import { chmodSync } from 'node:fs';

/** Creates a self-signed certificate for 127.0.0.1: PREFIX.crt and PREFIX.key. */
export function certify(prefix, name) {
  execFileSync('openssl', ['req', '-x509', '-newkey', 'ec', '-pkeyopt', 'ec_paramgen_curve:P-256', '-nodes', '-days', '30', '-subj',
    `/CN=${name}`, '-addext', 'subjectAltName=IP:127.0.0.1', '-keyout', `${prefix}.key`, '-out', `${prefix}.crt`], { stdio: 'ignore' });
  chmodSync(`${prefix}.key`, 0o600);
}
