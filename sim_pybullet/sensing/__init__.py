"""What reaches a policy of what there is: sensor, delays, repeated pictures, wrong poses."""
