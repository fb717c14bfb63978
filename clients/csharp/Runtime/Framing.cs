// SPDX-License-Identifier: Apache-2.0
using System.IO;
using Lightprobe.Messages;

namespace Lightprobe
{
    /// <summary>Messages on a stream: each has its length before it, as a varint.</summary>
    internal static class Framing
    {
        /// <summary>A probe sends no message that is longer: the largest is a reflection map.</summary>
        internal const int MostBytes = 1 << 20;

        /// <summary>Reads the next message; null: the stream has ended.</summary>
        /// <exception cref="WireException">What came is no message.</exception>
        internal static FromProbe Read(Stream stream)
        {
            int length = 0;
            for (int shift = 0; ; shift += 7)
            {
                int part = stream.ReadByte();
                if (part < 0) return null;
                if (shift > 21) throw new WireException("a length of more than four bytes");
                length |= (part & 127) << shift;
                if (part < 128) break;
            }
            if (length > MostBytes) throw new WireException("a message of " + length + " bytes");
            var data = new byte[length];
            for (int at = 0; at < length;)
            {
                int count = stream.Read(data, at, length - at);
                if (count == 0) return null;
                at += count;
            }
            return Decode(data);
        }

        /// <summary>Reads one message without its length.</summary>
        /// <exception cref="WireException">It is none.</exception>
        internal static FromProbe Decode(byte[] data) => FromProbe.Read(new WireReader(data, 0, data.Length));

        internal static byte[] Delimited(FromClient message)
        {
            var framed = new WireWriter();
            framed.Delimited(message.Write(new WireWriter()));
            return framed.ToArray();
        }
    }
}
