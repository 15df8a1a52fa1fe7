"""Serial lines, sockets and URIs: what every driver reads and writes by."""
