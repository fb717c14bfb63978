/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Pictures out of a multipart/x-mixed-replace stream (RFC 2046), as cameras send it: with or
 * without Content-Length, which may be wrong, with boundaries that may lack their two dashes or
 * their line end, may be followed by blanks and may be cut anywhere. Bytes go from the network's
 * buffer straight into the picture's. No I/O.
 */
#ifndef LP_SOURCE_OSC_MULTIPART_H
#define LP_SOURCE_OSC_MULTIPART_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define LP_MULTIPART_MOST_BYTES ((size_t)16 << 20) /* of one part */
#define LP_MULTIPART_LINE_BYTES 256

/* Where the parts go. */
struct lp_multipart_sink {
	void *context;
	/* Room for `size_bytes` of the part that is being read; what is in it already stays. NULL:
	 * the part is left out. */
	uint8_t *(*reserve)(void *context, size_t size_bytes);
	/* Is this a whole picture? Asked where one may end before its boundary has come. */
	bool (*is_whole)(void *context, const uint8_t *data, size_t size_bytes);
	/* The part ends; its bytes are where reserve() said. It may be damaged. */
	void (*part)(void *context, size_t size_bytes);
};

enum lp_multipart_state { LP_MULTIPART_SEEK, LP_MULTIPART_HEADER, LP_MULTIPART_BODY };

struct lp_multipart {
	struct lp_multipart_sink sink;
	char boundary[80]; /* without the dashes that RFC 2046 puts before it */
	size_t boundary_bytes;
	enum lp_multipart_state state;
	char line[LP_MULTIPART_LINE_BYTES]; /* of boundary or header, as far as it has come */
	size_t line_bytes;
	size_t length_bytes; /* as the header says; 0: it does not, or it was wrong */
	uint8_t *body;
	size_t body_bytes;
};

/* `content_type` of the answer. -EPROTO: it is no multipart stream, or its boundary is missing or
 * longer than RFC 2046 allows. */
int lp_multipart_init(struct lp_multipart *multipart, const char *content_type,
		      const struct lp_multipart_sink *sink);

void lp_multipart_feed(struct lp_multipart *multipart, const uint8_t *data, size_t size_bytes);

#endif
