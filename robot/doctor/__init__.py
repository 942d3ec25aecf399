"""What is right and wrong with this computer as a robot, and what to do about it.

``findings`` tell, ``machine`` looks, the other modules judge what it saw.
"""
