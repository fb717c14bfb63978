/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/publisher/websocket/pair.h"

#include <errno.h>
#include <fcntl.h>
#include <openssl/err.h>
#include <openssl/pem.h>
#include <openssl/ssl.h>
#include <openssl/x509.h>
#include <stdio.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/log.h"

#define TOKEN_LEAST 16
#define TOKEN_LETTERS "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-_"

static int pair_error(const char *object, const char *path, const char *reason)
{
	lp_error(object, "pair", "%s: %s — make it with lightprobe pair", path, reason);
	return -EINVAL;
}

/* A regular file, or what a link leads to: nobody waits for a FIFO. NULL: logged. */
static FILE *open_file(const char *object, const char *path, bool is_secret)
{
	const int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);
	struct stat status;
	FILE *file = NULL;

	if (fd < 0 || fstat(fd, &status) < 0) {
		lp_error(object, "pair",
			 "%s: %s — make it with lightprobe pair, and let this user read it", path,
			 lp_strerror(errno));
	} else if (!S_ISREG(status.st_mode)) {
		(void)pair_error(object, path, "is no file");
	} else {
		file = fdopen(fd, "r");
		if (is_secret && status.st_mode & S_IRWXO)
			lp_warning(object, "pair",
				   "%s: every user of this machine can read it — chmod 600 it, and "
				   "make a new one with lightprobe pair --new",
				   path);
	}
	if (!file && fd >= 0)
		close(fd);
	return file;
}

static int read_token(struct lp_pair *pair, const char *object, const char *path)
{
	FILE *file = open_file(object, path, true);
	size_t length;

	if (!file)
		return -ENOENT;
	if (!fgets(pair->token, sizeof(pair->token), file))
		pair->token[0] = '\0';
	(void)fclose(file);
	pair->token[strcspn(pair->token, "\r\n")] = '\0';
	length = strlen(pair->token);
	if (length < TOKEN_LEAST || strspn(pair->token, TOKEN_LETTERS) != length)
		return pair_error(object, path, "holds no token");
	return 0;
}

/* NULL: logged. */
static STACK_OF(X509) * read_chain(const char *object, const char *path)
{
	FILE *file = open_file(object, path, false);
	STACK_OF(X509) *chain = sk_X509_new_null();
	X509 *certificate;

	while (file && chain && (certificate = PEM_read_X509(file, NULL, NULL, NULL)))
		if (!sk_X509_push(chain, certificate))
			X509_free(certificate);
	ERR_clear_error(); /* of the file's end */
	if (file)
		(void)fclose(file);
	if (chain && sk_X509_num(chain) > 0)
		return chain;
	sk_X509_free(chain);
	if (file)
		(void)pair_error(object, path, "holds no certificate");
	return NULL;
}

static EVP_PKEY *read_key(const char *object, const char *path)
{
	FILE *file = open_file(object, path, true);
	EVP_PKEY *key;

	if (!file)
		return NULL;
	key = PEM_read_PrivateKey(file, NULL, NULL, (void *)""); /* no password is asked for */
	(void)fclose(file);
	if (!key)
		(void)pair_error(object, path, "holds no key");
	return key;
}

/* -EAGAIN: not now. */
static int check_validity(const char *object, const char *path, const X509 *certificate)
{
	const char *reason = NULL;

	if (X509_cmp_current_time(X509_get0_notAfter(certificate)) < 0)
		reason = "has expired — make another with lightprobe pair --new";
	else if (X509_cmp_current_time(X509_get0_notBefore(certificate)) > 0)
		reason = "is not valid yet — is the clock of this machine right?";
	if (!reason)
		return 0;
	lp_warning(object, "pair", "%s: the certificate %s; this publisher waits", path, reason);
	return -EAGAIN;
}

static int64_t expiry_of(const X509 *certificate)
{
	struct tm utc;

	if (ASN1_TIME_to_tm(X509_get0_notAfter(certificate), &utc) != 1)
		return 0;
	return (int64_t)timegm(&utc) * LP_NS_PER_S;
}

static void write_fingerprint(struct lp_pair *pair, const X509 *certificate)
{
	unsigned char digest[EVP_MAX_MD_SIZE];
	unsigned int length = 0;

	(void)X509_digest(certificate, EVP_sha256(), digest, &length);
	for (unsigned int i = 0; i < length; i++)
		(void)snprintf(pair->fingerprint + 3 * (size_t)i,
			       sizeof(pair->fingerprint) - 3 * (size_t)i, "%02X%s", digest[i],
			       i + 1 < length ? ":" : "");
}

static int check_certificate(struct lp_pair *pair, const char *object)
{
	X509 *certificate;
	int ret;

	pair->chain = read_chain(object, pair->certificate_path);
	pair->key = read_key(object, pair->key_path);
	if (!pair->chain || !pair->key)
		return -EINVAL;
	certificate = sk_X509_value(pair->chain, 0);
	if (X509_check_private_key(certificate, pair->key) != 1) {
		ERR_clear_error();
		return pair_error(object, pair->key_path, "belongs to another certificate");
	}
	ret = check_validity(object, pair->certificate_path, certificate);
	if (ret == 0) {
		write_fingerprint(pair, certificate);
		pair->t_expires_unix_ns = expiry_of(certificate);
	}
	return ret;
}

static const char *const names[LP_PAIR_FILES] = {"certificate.pem", "key.pem", "token"};

int lp_pair_read(struct lp_pair *pair, const char *object, const char *folder)
{
	char token[LP_PAIR_PATH_BYTES];
	int ret;

	*pair = (struct lp_pair){0};
	(void)snprintf(pair->certificate_path, sizeof(pair->certificate_path), "%s/%s", folder,
		       names[0]);
	(void)snprintf(pair->key_path, sizeof(pair->key_path), "%s/%s", folder, names[1]);
	(void)snprintf(token, sizeof(token), "%s/%s", folder, names[2]);
	ret = read_token(pair, object, token);
	if (ret == 0)
		ret = check_certificate(pair, object);
	if (ret < 0)
		lp_pair_finish(pair);
	return ret;
}

int lp_pair_use(const struct lp_pair *pair, const char *object, SSL_CTX *tls)
{
	const EVP_PKEY *former = SSL_CTX_get0_privatekey(tls);
	bool done;

	/* OpenSSL keeps a certificate of each kind, and would go on showing the former. */
	if (former && EVP_PKEY_get_base_id(former) != EVP_PKEY_get_base_id(pair->key)) {
		lp_error(object, "pair",
			 "the new key is of another kind (RSA, EC) — restart lightprobed");
		return -ENOTSUP;
	}
	done = SSL_CTX_use_certificate(tls, sk_X509_value(pair->chain, 0)) == 1 &&
	       SSL_CTX_use_PrivateKey(tls, pair->key) == 1;
	(void)SSL_CTX_clear_chain_certs(tls);
	for (int k = 1; k < sk_X509_num(pair->chain); k++)
		done = SSL_CTX_add1_chain_cert(tls, sk_X509_value(pair->chain, k)) == 1 && done;
	ERR_clear_error();
	if (!done)
		lp_error(object, "pair",
			 "the new certificate cannot be used — make another with lightprobe pair "
			 "--new");
	return done ? 0 : -EINVAL;
}

void lp_pair_finish(struct lp_pair *pair)
{
	sk_X509_pop_free(pair->chain, X509_free);
	EVP_PKEY_free(pair->key);
	pair->chain = NULL;
	pair->key = NULL;
}

struct lp_pair_stamp lp_pair_stamp(const char *folder)
{
	struct lp_pair_stamp stamp = {0};

	for (int k = 0; k < LP_PAIR_FILES; k++) {
		char path[LP_PAIR_PATH_BYTES];
		struct stat status;

		(void)snprintf(path, sizeof(path), "%s/%s", folder, names[k]);
		if (stat(path, &status) < 0)
			continue;
		stamp.changed[k] = status.st_mtim;
		stamp.devices[k] = status.st_dev;
		stamp.inodes[k] = status.st_ino;
		stamp.sizes[k] = status.st_size;
	}
	return stamp;
}

bool lp_pair_stamps_are_same(const struct lp_pair_stamp *a, const struct lp_pair_stamp *b)
{
	for (int k = 0; k < LP_PAIR_FILES; k++) {
		if (a->changed[k].tv_sec != b->changed[k].tv_sec ||
		    a->changed[k].tv_nsec != b->changed[k].tv_nsec ||
		    a->devices[k] != b->devices[k] || a->inodes[k] != b->inodes[k] ||
		    a->sizes[k] != b->sizes[k])
			return false;
	}
	return true;
}
