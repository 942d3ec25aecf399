"""Links between robot, localizer and monitor: what they say, to whom, and how fresh it is.

| file | what it holds |
|---|---|
| ``messages``, ``telemetry``, ``commands`` | the messages, as frozen dataclasses |
| ``wire`` | JSON to and from them, strictly |
| ``freshness`` | age, order and plausibility at the receiver |
| ``keys`` | ``keygen``; roles: who speaks and who listens on which stream |
| ``allow_list`` | lets in whom its allow-list and the roles let in |
| ``sockets`` | ZeroMQ: publish and subscribe |
| ``command_server``, ``command_client`` | commands, with answers; one operator at a time |
| ``config`` | hosts, ports, and the sockets of each program |
"""
