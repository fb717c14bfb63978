/* SPDX-License-Identifier: Apache-2.0 */
/* What `lightprobe pair` makes: key, certificate and token in one folder. */
#ifndef LP_WEBSOCKET_PAIR_H
#define LP_WEBSOCKET_PAIR_H

#include <openssl/types.h>
#include <openssl/x509.h>
#include <stdbool.h>
#include <stdint.h>
#include <sys/stat.h>

#define LP_PAIR_PATH_BYTES 1100
#define LP_PAIR_FILES 3

struct lp_pair {
	char certificate_path[LP_PAIR_PATH_BYTES], key_path[LP_PAIR_PATH_BYTES];
	char token[129];
	char fingerprint[96]; /* SHA-256 of the certificate, as openssl prints it */
	int64_t t_expires_unix_ns;
	STACK_OF(X509) * chain; /* the certificate first, then those that it is signed with */
	EVP_PKEY *key;
};

/* How the files of a folder look from outside. */
struct lp_pair_stamp {
	struct timespec changed[LP_PAIR_FILES];
	dev_t devices[LP_PAIR_FILES];
	ino_t inodes[LP_PAIR_FILES];
	off_t sizes[LP_PAIR_FILES];
};

/*
 * Read the folder and check that it can serve now: the token has 16 to 128 letters, digits, '-' or
 * '_'; the key belongs to the certificate, which is valid today. -EAGAIN: it is not valid yet, or
 * no more. Otherwise -EINVAL or -errno. Logged under `object` with the next step; so is a key or a
 * token that others can read. Reads small files; anything else there is refused, not waited for.
 */
int lp_pair_read(struct lp_pair *pair, const char *object, const char *folder);

/* Show it to whoever connects from now on. 0 or -errno, logged: the former stays. */
int lp_pair_use(const struct lp_pair *pair, const char *object, SSL_CTX *tls);

/* Does nothing for a zeroed one, and after a failure. */
void lp_pair_finish(struct lp_pair *pair);

/* All zero: they are not there. */
struct lp_pair_stamp lp_pair_stamp(const char *folder);
bool lp_pair_stamps_are_same(const struct lp_pair_stamp *a, const struct lp_pair_stamp *b);

#endif
