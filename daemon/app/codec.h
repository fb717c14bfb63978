/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Between the daemon's structures and the bytes of proto/lightprobe.proto. The only file that sees
 * the generated protobuf code is codec.c. Packets carry their length prefix.
 */
#ifndef LP_APP_CODEC_H
#define LP_APP_CODEC_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "include/light_estimate.h"

struct lp_health_report;
struct lp_packet;

struct lp_subscription {
	float rate_hz; /* 0: every estimate */
	int sh_order, max_lights;
	bool total;		   /* SH with the lights in it */
	bool raw;		   /* not smoothed in time */
	float tolerance;	   /* relative; 0: the largest model allowed */
	uint32_t health_period_ms; /* 0: none */
	uint32_t number;	   /* the client's own, echoed in its estimates; 0: the defaults */
};

/* Everything that makes one client's estimate packet differ from another's. */
struct lp_variant {
	bool total;
	int sh_order, lights;
};

/* What the estimate itself does not know. */
struct lp_stamp {
	uint32_t boot_id;
	uint32_t ttl_ms;
	uint32_t subscription; /* number that the client gave to what it wants */
	int64_t t_send_ns;     /* CLOCK_MONOTONIC */
};

struct lp_hello {
	uint32_t boot_id;
	const char *source; /* scheme */
	const char *preset;
	int max_sh_order, max_lights;
	uint32_t smoothing_ms;
	bool has_wheel, has_ring;
	const char *name; /* of this probe */
	bool insecure_lan;
};

/* -ERANGE: the estimate holds a number that is not finite where one must be; nothing is sent then.
 */
int lp_encode_estimate(const struct lp_light_estimate *estimate, const struct lp_variant *variant,
		       const struct lp_stamp *stamp, struct lp_packet *packet);
void lp_encode_hello(const struct lp_hello *hello, struct lp_packet *packet);
void lp_encode_health(const struct lp_health_report *report, struct lp_packet *packet);
void lp_encode_error(int code, const char *text, struct lp_packet *packet);

/*
 * -EBADMSG: no FromClient message. -EOPNOTSUPP: a request this version does not know. -ERANGE: a
 * value makes no sense. `*reason` (static) then says what. Values above what the daemon offers are
 * no error: they are upper bounds.
 */
int lp_decode_request(const uint8_t *data, size_t size_bytes, struct lp_subscription *subscription,
		      const char **reason);

struct lp_subscription lp_default_subscription(void);

#endif
