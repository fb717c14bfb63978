/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/publisher/websocket/pair.h"

#include <errno.h>
#include <openssl/pem.h>
#include <openssl/x509.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#include "base/clock.h"
#include "base/log.h"

#define TOKEN_LEAST 16
#define TOKEN_LETTERS "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-_"

static int pair_error(const char *object, const char *path, const char *reason)
{
	lp_error(object, "pair", "%s: %s — make it with lightprobe pair", path, reason);
	return -EINVAL;
}

static FILE *open_file(const char *object, const char *path)
{
	FILE *file = fopen(path, "re");

	if (!file)
		lp_error(object, "pair",
			 "%s: %s — make it with lightprobe pair, and let this user read it", path,
			 lp_strerror(errno));
	return file;
}

static int read_token(struct lp_pair *pair, const char *object, const char *path)
{
	FILE *file = open_file(object, path);
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

static X509 *read_certificate(const char *object, const char *path)
{
	FILE *file = open_file(object, path);
	X509 *certificate;

	if (!file)
		return NULL;
	certificate = PEM_read_X509(file, NULL, NULL, NULL);
	(void)fclose(file);
	if (!certificate)
		(void)pair_error(object, path, "holds no certificate");
	return certificate;
}

static EVP_PKEY *read_key(const char *object, const char *path)
{
	FILE *file = open_file(object, path);
	EVP_PKEY *key;

	if (!file)
		return NULL;
	key = PEM_read_PrivateKey(file, NULL, NULL, (void *)""); /* no password is asked for */
	(void)fclose(file);
	if (!key)
		(void)pair_error(object, path, "holds no key");
	return key;
}

static int check_validity(const char *object, const char *path, const X509 *certificate)
{
	if (X509_cmp_current_time(X509_get0_notAfter(certificate)) < 0)
		return pair_error(object, path, "the certificate has expired");
	if (X509_cmp_current_time(X509_get0_notBefore(certificate)) > 0) {
		lp_error(object, "pair",
			 "%s: the certificate is not valid yet — is the clock of this machine "
			 "right?",
			 path);
		return -EINVAL;
	}
	return 0;
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
	X509 *certificate = read_certificate(object, pair->certificate);
	EVP_PKEY *key = read_key(object, pair->key);
	int ret = -EINVAL;

	if (certificate && key) {
		ret = check_validity(object, pair->certificate, certificate);
		if (ret == 0 && X509_check_private_key(certificate, key) != 1)
			ret = pair_error(object, pair->key, "belongs to another certificate");
		if (ret == 0) {
			write_fingerprint(pair, certificate);
			pair->t_expires_unix_ns = expiry_of(certificate);
		}
	}
	EVP_PKEY_free(key);
	X509_free(certificate);
	return ret;
}

int lp_pair_read(struct lp_pair *pair, const char *object, const char *folder)
{
	char token[LP_PAIR_PATH_BYTES];
	int ret;

	*pair = (struct lp_pair){0};
	(void)snprintf(pair->certificate, sizeof(pair->certificate), "%s/certificate.pem", folder);
	(void)snprintf(pair->key, sizeof(pair->key), "%s/key.pem", folder);
	(void)snprintf(token, sizeof(token), "%s/token", folder);
	ret = read_token(pair, object, token);
	return ret < 0 ? ret : check_certificate(pair, object);
}
