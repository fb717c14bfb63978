/* SPDX-License-Identifier: Apache-2.0 */
/* What the daemon is made of, for daemon.c (what happens) and daemon_create.c (its parts). */
#ifndef LP_APP_DAEMON_PARTS_H
#define LP_APP_DAEMON_PARTS_H

#include <stdbool.h>
#include <stdint.h>

#include "app/box/instruments.h"
#include "app/box/orientation.h"
#include "app/box/ring_watch.h"
#include "app/daemon.h"
#include "app/options/options.h"
#include "app/run/governor.h"
#include "app/run/time_control.h"
#include "app/run/worker.h"
#include "base/loop.h"
#include "estimate/ring/ring_only.h"
#include "include/frame.h"
#include "include/orientation.h"
#include "include/source.h"
#include "serve/health.h"
#include "serve/hub.h"
#include "vision/camera/camera_file.h"

struct lp_daemon;

/* Of the certificate that ends first. */
enum lp_validity { LP_VALID, LP_EXPIRES_SOON, LP_EXPIRED };

/* A source of frames, and what has come from it. */
struct lp_daemon_camera {
	struct lp_daemon *daemon;
	int index;	 /* lp_frame.camera of its frames */
	const char *uri; /* names it in messages */
	struct lp_camera_file *file;
	struct lp_source *source;
	struct lp_source_caps caps;
	enum lp_source_state state; /* 0: not known yet */
	bool has_streamed;
	bool has_frames;	 /* the next one counts */
	uint64_t next_sequence;	 /* of the source, if nothing is lost */
	int64_t t_read_ns;	 /* of the newest frame; 0: there is none */
	float period_us;	 /* of its frames; infinite: not known */
	const char *clock_fault; /* of its newest frame, as told in health */
	bool told;		 /* --once: all that it has to say has been heard */
};

struct lp_daemon {
	const struct lp_options *options;
	struct lp_loop *loop;
	struct lp_timer tick;
	struct lp_time_control *time_control; /* NULL: the system's time */
	struct lp_watch results;	      /* of the worker */
	uint64_t results_lost;
	struct lp_hub *hub;
	struct lp_worker *worker;
	struct lp_daemon_camera cameras[LP_MAX_CAMERAS];
	struct lp_instruments *instruments;
	struct lp_orientation_teller orientation;
	struct lp_orientation *sensor; /* of orientation; NULL: none */
	char name[64];		       /* of the probe */
	struct lp_publisher *publishers[LP_MAX_PUBLISHERS];
	int camera_count; /* 0: the ring alone */
	int publisher_count;
	enum lp_validity validity;
	const char *waits_for; /* a publisher does; NULL: none */
	struct lp_health health;
	struct lp_ring_watch ring_watch;
	struct lp_ring_only ring_only;
	struct lp_estimates ring_estimates; /* of the ring alone: too large for a stack */
	struct lp_governor governor;
	char preset_reason[96];	    /* of the last change that was asked for */
	uint64_t frames_lost;	    /* between the cameras and us */
	uint64_t frames_corrupt;    /* while a source did not stream: the worker never saw them */
	struct lp_result once_best; /* --once: the newest estimate of the set */
	int64_t watchdog_ns;	    /* 0: nobody watches */
	int64_t fed_ns;		    /* the watchdog, last */
	int64_t ending_ns;	    /* since when; 0: running */
	enum lp_exit exit_code;
	bool once_has_best;
};

/* daemon_cameras.c: open every --source; and all of them end. */
int lp_daemon_create_cameras(struct lp_daemon *daemon);
int lp_daemon_start_cameras(struct lp_daemon *daemon);
void lp_daemon_destroy_sources(struct lp_daemon *daemon);
/* After everything else has gone. */
void lp_daemon_destroy_camera_files(struct lp_daemon *daemon);

/* The last packets leave, and then the daemon ends. */
void lp_daemon_begin_ending(struct lp_daemon *daemon, enum lp_exit exit_code);

/* What happens, on the loop; `context` is the daemon. */
void lp_daemon_on_fault(void *context, const char *id, const char *text);
void lp_daemon_on_stamped_frame(void *context, struct lp_frame *frame);
void lp_daemon_on_ring(void *context, const struct lp_ring_sample *sample);
void lp_daemon_on_publisher_failed(void *context, int failure);
int lp_daemon_on_pose(void *context, const void *client,
		      const struct lp_orientation_sample *sample);
int lp_daemon_on_sweep(void *context, uint64_t *done_at, const char **reason);
int lp_daemon_on_stills(void *context, const char **reason); /* daemon_cameras.c */
void lp_daemon_on_client_left(void *context, const void *client);
void lp_daemon_on_orientation_sample(void *context, const struct lp_orientation_sample *sample);

/* Everything but the loop and the timers; whoever fails has said why. */
int lp_daemon_create_parts(struct lp_daemon *daemon);
/* Also after a failure half way. */
void lp_daemon_destroy_parts(struct lp_daemon *daemon);

#endif
