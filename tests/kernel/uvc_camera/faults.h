/* SPDX-License-Identifier: Apache-2.0 */
/* How the camera misbehaves; set by commands, read by the threads of USB. */
#ifndef UVC_CAMERA_FAULTS_H
#define UVC_CAMERA_FAULTS_H

#include <stdatomic.h>

/* The first group counts frames that will be wrong; the second is 0 or 1 until changed. */
enum fault {
	FAULT_EMPTY,	  /* frame without any data */
	FAULT_ERROR_BIT,  /* payload header says: error */
	FAULT_TRUNCATED,  /* frame ends after half its data */
	FAULT_GARBAGE,	  /* right size, random bytes */
	FAULT_WRONG_SIZE, /* a picture of half the size that was agreed */
	FAULT_OVERLONG,	  /* frame goes on beyond its size */

	FAULT_SILENT,	       /* streaming, but no frames come */
	FAULT_HALT,	       /* endpoint halts once; the host must clear it */
	FAULT_HANG,	       /* no frames, every class request refused, until the port is reset */
	FAULT_MUTE,	       /* class requests are never answered: the host times out */
	FAULT_OTHER_SIZE,      /* whatever size the host asks for, the smallest is agreed */
	FAULT_IGNORE_EXPOSURE, /* exposure and gain are accepted and do nothing */
	FAULT_COUNT,
};

struct faults {
	atomic_int values[FAULT_COUNT];
};

static inline int fault_is_on(struct faults *faults, enum fault fault)
{
	return atomic_load(&faults->values[fault]) != 0;
}

/* Uses up one of the frames that shall be wrong. */
static inline int fault_take(struct faults *faults, enum fault fault)
{
	int left = atomic_load(&faults->values[fault]);

	while (left > 0)
		if (atomic_compare_exchange_weak(&faults->values[fault], &left, left - 1))
			return 1;
	return 0;
}

#endif
