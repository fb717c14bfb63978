/* SPDX-License-Identifier: Apache-2.0 */
#include "app/backends.h"

#include <errno.h>
#include <string.h>

#include "base/log.h"
#include "base/macros.h"
#include "base/param.h"
#include "base/uri.h"
#include "include/backend.h"
#include "include/orientation.h"
#include "include/publisher.h"
#include "include/ring.h"
#include "include/rotator.h"
#include "include/source.h"

extern const struct lp_source_ops lp_source_file_ops;
extern const struct lp_source_ops lp_source_sim_ops;
extern const struct lp_source_ops lp_source_v4l2_ops;
extern const struct lp_source_ops lp_source_libcamera_ops;
extern const struct lp_source_ops lp_source_osc_ops;
extern const struct lp_source_ops lp_source_ptp_ops;
extern const struct lp_source_ops lp_source_example_ops;
extern const struct lp_rotator_ops lp_rotator_mcu_ops;
extern const struct lp_rotator_ops lp_rotator_pca9685_ops;
extern const struct lp_rotator_ops lp_rotator_sim_ops;
extern const struct lp_ring_ops lp_ring_i2c_ops;
extern const struct lp_ring_ops lp_ring_mcu_ops;
extern const struct lp_ring_ops lp_ring_sim_ops;
extern const struct lp_orientation_ops lp_orientation_iio_ops;
extern const struct lp_publisher_ops lp_publisher_tcp_ops;
extern const struct lp_publisher_ops lp_publisher_unix_ops;
extern const struct lp_publisher_ops lp_publisher_ws_ops;
extern const struct lp_publisher_ops lp_publisher_wss_ops;
extern const struct lp_publisher_ops lp_publisher_mqtt_ops;
extern const struct lp_publisher_ops lp_publisher_mqtts_ops;
extern const struct lp_publisher_ops lp_publisher_stdout_ops;

/* What stands for a back end that this build has not. */
#define LEFT_OUT(role, name, with) \
	(&(const struct lp_##role##_ops){.info = {.scheme = (name), .left_out = (with)}})

static const struct lp_source_ops *const sources[] = {
	&lp_source_v4l2_ops,
	WITH_LIBCAMERA ? &lp_source_libcamera_ops : LEFT_OUT(source, "libcamera", "WITH_LIBCAMERA"),
	WITH_OSC ? &lp_source_osc_ops : LEFT_OUT(source, "osc", "WITH_OSC"),
	WITH_LIBUSB ? &lp_source_ptp_ops : LEFT_OUT(source, "ptp", "WITH_LIBUSB"),
	&lp_source_file_ops,
	WITH_SIM ? &lp_source_sim_ops : LEFT_OUT(source, "sim", "WITH_SIM"),
	&lp_source_example_ops,
};

static const struct lp_rotator_ops *const rotators[] = {
	&lp_rotator_mcu_ops,
	WITH_GPIOD ? &lp_rotator_pca9685_ops : LEFT_OUT(rotator, "pca9685", "WITH_GPIOD"),
	&lp_rotator_sim_ops,
};

static const struct lp_ring_ops *const rings[] = {
	&lp_ring_mcu_ops,
	&lp_ring_i2c_ops,
	&lp_ring_sim_ops,
};

static const struct lp_orientation_ops *const orientations[] = {
	WITH_IIO ? &lp_orientation_iio_ops : LEFT_OUT(orientation, "iio", "WITH_IIO"),
};

static const struct lp_publisher_ops *const publishers[] = {
	&lp_publisher_tcp_ops,
	&lp_publisher_unix_ops,
	WITH_WEBSOCKETS ? &lp_publisher_ws_ops : LEFT_OUT(publisher, "ws", "WITH_WEBSOCKETS"),
	WITH_WEBSOCKETS ? &lp_publisher_wss_ops : LEFT_OUT(publisher, "wss", "WITH_WEBSOCKETS"),
	WITH_MQTT ? &lp_publisher_mqtt_ops : LEFT_OUT(publisher, "mqtt", "WITH_MQTT"),
	WITH_MQTT ? &lp_publisher_mqtts_ops : LEFT_OUT(publisher, "mqtts", "WITH_MQTT"),
	&lp_publisher_stdout_ops,
};

/* ---------------------------------------------------------------- by scheme */

static void list_schemes(const struct lp_backend_role *role, char *text, size_t size_bytes)
{
	size_t used = 0;

	text[0] = '\0';
	for (int i = 0; i < role->count && used < size_bytes; i++)
		used += (size_t)snprintf(text + used, size_bytes - used,
					 used ? ", %s:" : "%s:", role->at(i)->scheme);
}

int lp_backend_find(const struct lp_backend_role *role, const struct lp_uri *uri)
{
	char known[128];

	for (int i = 0; i < role->count; i++) {
		const struct lp_backend *info = role->at(i);

		if (strcmp(info->scheme, uri->scheme) != 0)
			continue;
		if (!info->left_out)
			return i;
		lp_error(
			uri->text, role->option,
			"%s: is known, but not part of this build — build it with make daemon %s=1",
			info->scheme, info->left_out);
		return -EPROTONOSUPPORT;
	}
	list_schemes(role, known, sizeof(known));
	lp_error(uri->text, role->option, "%s: is not a known scheme; known are %s", uri->scheme,
		 known);
	return -EPROTONOSUPPORT;
}

/* A role: what its back ends in `list` say of themselves, and lp_ROLE_open(). */
#define ROLE(role, list, its_option, its_title)                                             \
	static const struct lp_backend *role##_at(int i)                                    \
	{                                                                                   \
		return &(list)[i]->info;                                                    \
	}                                                                                   \
	static const struct lp_backend_role role##_role = {its_option, its_title,           \
							   (int)LP_COUNT(list), role##_at}; \
	int lp_##role##_open(const char *text, const struct lp_##role##_host *host,         \
			     struct lp_##role **opened)                                     \
	{                                                                                   \
		struct lp_uri uri;                                                          \
		int found = lp_uri_parse(&uri, text);                                       \
                                                                                            \
		if (found == 0)                                                             \
			found = lp_backend_find(&role##_role, &uri);                        \
		return found < 0 ? found : (list)[found]->create(&uri, host, opened);       \
	}

ROLE(source, sources, "source", "Sources")
ROLE(rotator, rotators, "rotator", "Wheels")
ROLE(ring, rings, "ring", "Rings of light sensors")
ROLE(orientation, orientations, "orientation", "Orientation sensors")
ROLE(publisher, publishers, "publish", "Publishers")

const struct lp_backend_role *const lp_backend_roles[] = {&source_role,	   &rotator_role,
							  &ring_role,	   &orientation_role,
							  &publisher_role, NULL};

/* ---------------------------------------------------------------- help */

static void print_line(FILE *out, const struct lp_backend *info)
{
	char uri[64];

	(void)snprintf(uri, sizeof(uri), "%s:%s", info->scheme, info->form);
	(void)fprintf(out, "  %-19s %.*s\n", uri, (int)strcspn(info->help, "\n"), info->help);
}

static void print_keys(FILE *out, const struct lp_backend *info)
{
	(void)fprintf(out, "  %s:%s\n", info->scheme, info->form);
	lp_print_indented(out, 6, info->help);
	lp_param_print(out, "      ", info->params);
}

static void print_all(FILE *out, void (*print)(FILE *out, const struct lp_backend *info))
{
	for (int k = 0; lp_backend_roles[k]; k++) {
		const struct lp_backend_role *role = lp_backend_roles[k];

		(void)fprintf(out, "\n%s (--%s):\n", role->title, role->option);
		for (int i = 0; i < role->count; i++) {
			if (!role->at(i)->left_out)
				print(out, role->at(i));
		}
	}
}

void lp_backends_list(FILE *out)
{
	print_all(out, print_line);
}

void lp_backends_help(FILE *out)
{
	(void)fputs("URIs have the form SCHEME:REST?KEY=VALUE&KEY=VALUE. These are the keys, with "
		    "their defaults:\n",
		    out);
	print_all(out, print_keys);
}

void lp_backends_version(FILE *out)
{
	(void)fprintf(out, "WITH_SYSTEMD=%d\nWITH_SIM=%d\nWITH_LIBUSB=%d\n", WITH_SYSTEMD, WITH_SIM,
		      WITH_LIBUSB);
	(void)fprintf(out, "WITH_GPIOD=%d\nWITH_LIBCAMERA=%d\nWITH_OSC=%d\n", WITH_GPIOD,
		      WITH_LIBCAMERA, WITH_OSC);
	(void)fprintf(out, "WITH_WEBSOCKETS=%d\nWITH_IIO=%d\nWITH_MQTT=%d\n", WITH_WEBSOCKETS,
		      WITH_IIO, WITH_MQTT);
}
