// SPDX-License-Identifier: Apache-2.0
using System;
using System.Globalization;

namespace Lightprobe
{
    /// <summary>tcp:HOST:PORT; an IPv6 host in brackets.</summary>
    internal sealed class TcpAddress
    {
        private const string Expected = ": address: expected tcp:HOST:PORT, as tcp:127.0.0.1:7700";

        internal readonly string Host;
        internal readonly int Port;

        private TcpAddress(string host, int port)
        {
            Host = host;
            Port = port;
        }

        public override string ToString() => "tcp:" + (Host.Contains(":") ? "[" + Host + "]" : Host) + ":" + Port;

        /// <exception cref="ArgumentException">It is no such address.</exception>
        internal static TcpAddress Parse(string text)
        {
            if (text.StartsWith("ws:", StringComparison.Ordinal) || text.StartsWith("wss:", StringComparison.Ordinal)
                || text.StartsWith("https:", StringComparison.Ordinal))
                throw new ArgumentException(text + ": address: this client knows tcp: alone");
            int colon = text.LastIndexOf(':');
            if (!text.StartsWith("tcp:", StringComparison.Ordinal) || colon < 5)
                throw new ArgumentException(text + Expected);
            string host = text.Substring(4, colon - 4);
            if (host.StartsWith("[", StringComparison.Ordinal) && host.EndsWith("]", StringComparison.Ordinal))
                host = host.Substring(1, host.Length - 2);
            if (host.Length == 0 || !int.TryParse(text.Substring(colon + 1), NumberStyles.None, CultureInfo.InvariantCulture, out int port)
                || port < 1 || port > 65535)
                throw new ArgumentException(text + Expected);
            return new TcpAddress(host, port);
        }
    }
}
