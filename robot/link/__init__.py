"""Links between robot, localizer and monitor: what they say, to whom, and how fresh it is.

| file | what it holds |
|---|---|
| ``messages``, ``telemetry``, ``commands`` | the messages, as frozen dataclasses |
| ``wire`` | JSON to and from them, strictly |
| ``freshness`` | age, order and plausibility at the receiver |
| ``keys`` | ``keygen`` and the allow-lists |
| ``sockets``, ``streams`` | ZeroMQ: the door, publish and subscribe |
| ``command_server``, ``command_client`` | commands, with answers |
| ``config`` | hosts, ports, and the sockets of each program |
"""
