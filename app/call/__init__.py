"""Calls between two to eight people: each partner is another source of DrivenFrames.

wire: what travels and who may read it; media: voice and face on one clock; rooms: how the ends
find each other; core: one end and its partners; live: its process beside a live run; table: the
partners as they are drawn; trial: both ends on one machine over a lossy line.
"""
