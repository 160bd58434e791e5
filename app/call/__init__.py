"""A call: two to eight people, each one more source of DrivenFrames to the others.

wire: what travels and who may read it; media: voice and face on one clock; rooms: how the ends
find each other; trial: both ends on one machine over a lossy line.
"""
