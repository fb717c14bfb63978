/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/libcamera/log.hpp"

#include <ostream>
#include <streambuf>
#include <string>

#include <libcamera/logging.h>

#include "drivers/source/libcamera/c.hpp"

namespace lp
{
namespace
{

/* The word at `at`, which is moved behind it. */
std::string take_word(const std::string &line, size_t &at)
{
	const size_t begin = line.find_first_not_of(' ', at);
	const size_t end = begin == std::string::npos ? begin : line.find(' ', begin);

	at = end == std::string::npos ? line.size() : end;
	return begin == std::string::npos ? "" : line.substr(begin, at - begin);
}

/* "[0:00:12.345] [678] WARN Category file.cpp:90 text", as libcamera writes each message. */
void forward(const std::string &line)
{
	size_t at = line.find("] [");

	at = at == std::string::npos ? 0 : line.find(']', at + 3) + 1;
	const std::string severity = take_word(line, at);
	const std::string category = take_word(line, at);
	const bool serious = severity == "WARN" || severity == "ERROR" || severity == "FATAL";

	take_word(line, at); /* its place in libcamera's sources */
	const std::string text = line.substr(line.find_first_not_of(' ', at) == std::string::npos
						     ? line.size()
						     : line.find_first_not_of(' ', at));

	lp_log(serious ? LP_LOG_WARNING : LP_LOG_DEBUG, "libcamera", category.c_str(), "%s",
	       text.substr(0, text.find('\n')).c_str());
}

/* libcamera writes a message by one call, from any of its threads: nothing is kept between calls.
 */
class Forwarder : public std::streambuf
{
      protected:
	std::streamsize xsputn(const char *text, std::streamsize count) override
	{
		forward(std::string(text, static_cast<size_t>(count)));
		return count;
	}
	int overflow(int c) override
	{
		return c;
	}
};

} // namespace

void take_over_log()
{
	/* Outlives libcamera's last message, which may come while the program ends. */
	static auto *const stream = new std::ostream(new Forwarder);

	libcamera::logSetStream(stream, false);
}

} // namespace lp
