"""Study of plateaus: does the error of PBD stop at C + M h with C > 0?"""
