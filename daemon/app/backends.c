/* SPDX-License-Identifier: Apache-2.0 */
#include "app/backends.h"

#include <errno.h>
#include <string.h>

#include "base/log.h"
#include "base/uri.h"
#include "include/publisher.h"
#include "include/ring.h"
#include "include/rotator.h"
#include "include/source.h"

extern const struct lp_source_ops lp_source_file_ops;
extern const struct lp_source_ops lp_source_sim_ops;
extern const struct lp_source_ops lp_source_v4l2_ops;
extern const struct lp_source_ops lp_source_libcamera_ops;
extern const struct lp_source_ops lp_source_example_ops;
extern const struct lp_rotator_ops lp_rotator_mcu_ops;
extern const struct lp_rotator_ops lp_rotator_pca9685_ops;
extern const struct lp_rotator_ops lp_rotator_sim_ops;
extern const struct lp_ring_ops lp_ring_mcu_ops;
extern const struct lp_ring_ops lp_ring_sim_ops;
extern const struct lp_publisher_ops lp_publisher_tcp_ops;
extern const struct lp_publisher_ops lp_publisher_unix_ops;
extern const struct lp_publisher_ops lp_publisher_stdout_ops;

static const struct lp_backend sources[] = {
	{"v4l2", NULL, &lp_source_v4l2_ops},
	{"libcamera", "WITH_LIBCAMERA", WITH_LIBCAMERA ? &lp_source_libcamera_ops : NULL},
	{"file", NULL, &lp_source_file_ops},
	{"sim", "WITH_SIM", WITH_SIM ? &lp_source_sim_ops : NULL},
	{"example", NULL, &lp_source_example_ops},
	{0},
};

static const struct lp_backend rotators[] = {
	{"mcu", NULL, &lp_rotator_mcu_ops},
	{"pca9685", "WITH_GPIOD", WITH_GPIOD ? &lp_rotator_pca9685_ops : NULL},
	{"sim", NULL, &lp_rotator_sim_ops},
	{0},
};

static const struct lp_backend rings[] = {
	{"mcu", NULL, &lp_ring_mcu_ops},
	{"sim", NULL, &lp_ring_sim_ops},
	{0},
};

static const struct lp_backend publishers[] = {
	{"tcp", NULL, &lp_publisher_tcp_ops},
	{"unix", NULL, &lp_publisher_unix_ops},
	{"stdout", NULL, &lp_publisher_stdout_ops},
	{0},
};

static void list_schemes(const struct lp_backend *table, char *text, size_t size_bytes)
{
	size_t used = 0;

	text[0] = '\0';
	for (; table->scheme && used < size_bytes; table++)
		used += (size_t)snprintf(text + used, size_bytes - used,
					 used ? ", %s:" : "%s:", table->scheme);
}

const void *lp_backend_find(const struct lp_backend *table, const char *role,
			    const struct lp_uri *uri)
{
	const struct lp_backend *row = table;
	char known[128];

	while (row->scheme && strcmp(row->scheme, uri->scheme) != 0)
		row++;
	if (row->ops)
		return row->ops;
	if (row->scheme) {
		lp_error(uri->text, role, "%s: is known but not in this build — make daemon %s=1",
			 row->scheme, row->option);
		return NULL;
	}
	list_schemes(table, known, sizeof(known));
	lp_error(uri->text, role, "%s: is no known scheme; known: %s", uri->scheme, known);
	return NULL;
}

int lp_source_open(const char *uri, const struct lp_source_host *host, struct lp_source **source)
{
	const struct lp_source_ops *ops;
	struct lp_uri parsed;

	if (lp_uri_parse(&parsed, uri) < 0)
		return -EINVAL;
	ops = lp_backend_find(sources, "source", &parsed);
	return ops ? ops->create(&parsed, host, source) : -EPROTONOSUPPORT;
}

int lp_rotator_open(const char *uri, const struct lp_rotator_host *host,
		    struct lp_rotator **rotator)
{
	const struct lp_rotator_ops *ops;
	struct lp_uri parsed;

	if (lp_uri_parse(&parsed, uri) < 0)
		return -EINVAL;
	ops = lp_backend_find(rotators, "rotator", &parsed);
	return ops ? ops->create(&parsed, host, rotator) : -EPROTONOSUPPORT;
}

int lp_ring_open(const char *uri, const struct lp_ring_host *host, struct lp_ring **ring)
{
	const struct lp_ring_ops *ops;
	struct lp_uri parsed;

	if (lp_uri_parse(&parsed, uri) < 0)
		return -EINVAL;
	ops = lp_backend_find(rings, "ring", &parsed);
	return ops ? ops->create(&parsed, host, ring) : -EPROTONOSUPPORT;
}

int lp_publisher_open(const char *uri, const struct lp_publisher_host *host,
		      struct lp_publisher **publisher)
{
	const struct lp_publisher_ops *ops;
	struct lp_uri parsed;

	if (lp_uri_parse(&parsed, uri) < 0)
		return -EINVAL;
	ops = lp_backend_find(publishers, "publish", &parsed);
	return ops ? ops->create(&parsed, host, publisher) : -EPROTONOSUPPORT;
}

void lp_backends_help(FILE *out)
{
	(void)fputs("\nSources:\n", out);
	for (const struct lp_backend *row = sources; row->scheme; row++) {
		if (row->ops)
			(void)fprintf(out, "  %s\n",
				      ((const struct lp_source_ops *)row->ops)->help);
	}
	(void)fputs("\nWheels (--rotator):\n", out);
	for (const struct lp_backend *row = rotators; row->scheme; row++) {
		if (row->ops)
			(void)fprintf(out, "  %s\n",
				      ((const struct lp_rotator_ops *)row->ops)->help);
	}
	(void)fputs("\nRings:\n", out);
	for (const struct lp_backend *row = rings; row->scheme; row++) {
		if (row->ops)
			(void)fprintf(out, "  %s\n", ((const struct lp_ring_ops *)row->ops)->help);
	}
	(void)fputs("\nPublishers:\n", out);
	for (const struct lp_backend *row = publishers; row->scheme; row++)
		(void)fprintf(out, "  %s\n", ((const struct lp_publisher_ops *)row->ops)->help);
}

void lp_backends_version(FILE *out)
{
	(void)fprintf(out, "WITH_SYSTEMD=%d\nWITH_SIM=%d\nWITH_LIBUSB=%d\n", WITH_SYSTEMD, WITH_SIM,
		      WITH_LIBUSB);
	(void)fprintf(out, "WITH_GPIOD=%d\nWITH_LIBCAMERA=%d\n", WITH_GPIOD, WITH_LIBCAMERA);
}
