/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Between the daemon's structures and the bytes of proto/lightprobe.proto. The only files that see
 * the generated protobuf code are codec*.c. Packets carry their length prefix.
 */
#ifndef LP_SERVE_CODEC_CODEC_H
#define LP_SERVE_CODEC_CODEC_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "include/light_estimate.h"
#include "serve/drawn/drawn.h"

struct lp_health_report;
struct lp_packet;
struct lp_polarization_grid;

/* A reflection map, as a client wants it. */
struct lp_reflection_wish {
	int size; /* texels along an edge: 16, 32, 64; 0: none */
	float rate_hz;
	bool total;
};

/* Who hears nothing for longer takes a probe for dead. */
#define LP_MOST_QUIET_MS 60000

struct lp_subscription {
	bool world;    /* in the app's world, where it is known */
	float rate_hz; /* 0: every estimate */
	int sh_order, max_lights;
	bool total;		   /* SH with the lights in it */
	bool raw;		   /* not smoothed in time */
	bool area_lights;	   /* listed, too */
	bool key_light;		   /* light/send/key.h */
	float tolerance;	   /* relative; 0: the largest model allowed */
	uint32_t health_period_ms; /* 0: none */
	uint32_t quiet_ms;	   /* between estimates that say nothing new; 0: all are sent */
	bool leave_out_reflections;
	struct lp_reflection_wish reflection; /* with has_draws: the most */
	bool has_draws;	       /* what follows decides; orders and lights are the most */
	struct lp_drawn draws; /* tolerance of each thing; 0: it is not drawn */
	uint32_t number;       /* the client's own, echoed in its estimates; 0: the defaults */
};

/* Everything that makes one client's estimate packet differ from another's. */
struct lp_variant {
	bool total, key;
	int sh_order, lights;
	bool world; /* directions and SH have been turned into the app's world */
	bool has_drawn;
	struct lp_drawn drawn; /* errors to state; NAN: none */
};

/* Times of a client are nanoseconds of its own clock, within LP_MOST_CLIENT_TIME_NS of 0. */
#define LP_MOST_CLIENT_TIME_NS INT64_C(2000000000000000000)

struct lp_client_pose {
	int64_t time_ns;
	double quaternion[4]; /* x y z w, head to world, as sent */
	double sigma_rad;
	double position_m[3]; /* in the world; all NAN: not sent */
	double position_sigma_m;
};

struct lp_client_ping {
	int64_t time_ns;
	bool has_pong_time;
	int64_t pong_time_ns; /* when the answer to the ping before came */
};

enum lp_request_kind {
	LP_REQUEST_SUBSCRIBE,
	LP_REQUEST_POSE,
	LP_REQUEST_PING,
	LP_REQUEST_POLARIZATION_MAP,
	LP_REQUEST_SWEEP,
	LP_REQUEST_STILLS,
};

/* What a client asks for or tells. */
struct lp_request {
	enum lp_request_kind kind;
	struct lp_subscription subscription;
	struct lp_client_pose pose;
	struct lp_client_ping ping;
};

/* The answer to a ping. */
struct lp_pong {
	int64_t ping_time_ns;
	int64_t t_received_ns, t_sent_ns; /* CLOCK_MONOTONIC */
};

/* What the estimate itself does not know. */
struct lp_stamp {
	uint32_t boot_id;
	uint32_t ttl_ms;
	uint32_t quiet_ms;     /* the client may be sent nothing for so long; it is STALE as ever */
	bool lasts;	       /* what is older than ttl_ms is not STALE: the estimate of a set */
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
	const char *orientation; /* what tells it */
	int max_reflection_size; /* 0: reflection maps are off */
	bool polarization_map;	 /* clients may ask for it */
	uint32_t processing_on;	 /* by the cameras: LP_PROCESSING_BIT() of each (processing.h) */
};

/* Of a reflection map, what the estimate and the stamp do not know. */
struct lp_reflection_header {
	int size;
	bool total;
	float scale;	       /* lp_cube_encode() */
	struct lp_drawn drawn; /* its errors; NAN: not known */
};

/* Most bytes of a reflection map's message beside its texels. */
#define LP_REFLECTION_HEADER_BYTES 128

/*
 * Of a message that holds measured numbers: -ERANGE, and an error in the log, where one of them is
 * not what proto/ranges.toml allows. The packet is not to be sent then. A number that may be absent
 * is left out instead, and what a sensor of the ring says becomes NaN.
 */
int lp_encode_estimate(const struct lp_light_estimate *estimate, const struct lp_variant *variant,
		       const struct lp_stamp *stamp, struct lp_packet *packet);
/* `texels`: of lp_cube_encode(). The packet has room for them and LP_REFLECTION_HEADER_BYTES.
 * (serve/codec/codec_reflection.c) */
int lp_encode_reflection_map(const struct lp_light_estimate *estimate,
			     const struct lp_reflection_header *header, const uint8_t *texels,
			     const struct lp_stamp *stamp, struct lp_packet *packet);
int lp_encode_health(const struct lp_health_report *report, struct lp_packet *packet);
/* `packet` has room for a picture. sweeps: as in the health report. */
int lp_encode_polarization(const struct lp_polarization_grid *grid, uint64_t sweeps,
			   struct lp_packet *packet);
/* For the files of this folder: 0 where `forbidden` is NULL; else it is logged, and -ERANGE. */
int lp_may_be_sent(const char *forbidden);

void lp_encode_hello(const struct lp_hello *hello, struct lp_packet *packet);
void lp_encode_pong(const struct lp_pong *pong, struct lp_packet *packet);
void lp_encode_sweep_started(uint64_t done_at, struct lp_packet *packet);
void lp_encode_stills_asked(uint32_t cameras, struct lp_packet *packet);
void lp_encode_error(int code, const char *text, struct lp_packet *packet);

/*
 * -EBADMSG: no FromClient message. -EOPNOTSUPP: a request this version does not know. -ERANGE: a
 * value makes no sense. `*reason` (static) then says what. Values above what the daemon offers are
 * no error: they are upper bounds. `request->kind` is valid with -ERANGE, too.
 */
int lp_decode_request(const uint8_t *data, size_t size_bytes, struct lp_request *request,
		      const char **reason);

struct lp_subscription lp_default_subscription(void);

#endif
