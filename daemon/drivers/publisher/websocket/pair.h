/* SPDX-License-Identifier: Apache-2.0 */
/* What `lightprobe pair` makes: key, certificate and token in one folder. */
#ifndef LP_WEBSOCKET_PAIR_H
#define LP_WEBSOCKET_PAIR_H

#include <stdint.h>

#define LP_PAIR_PATH_BYTES 1100

struct lp_pair {
	char certificate[LP_PAIR_PATH_BYTES], key[LP_PAIR_PATH_BYTES]; /* paths */
	char token[129];
	char fingerprint[96]; /* SHA-256 of the certificate, as openssl prints it */
	int64_t t_expires_unix_ns;
};

/*
 * Read the folder and check that it can serve now: the token has 16 to 128 letters, digits, '-' or
 * '_'; the key belongs to the certificate, which is valid today. -EINVAL or -errno, logged under
 * `object` with the next step. Blocks: before the loop runs.
 */
int lp_pair_read(struct lp_pair *pair, const char *object, const char *folder);

#endif
